"""Options of every session, checked before anything is sent."""

from dataclasses import dataclass
from typing import Any, ClassVar

from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import (
    MAX_BLOCK_PAIRS,
    Options,
    check_block_time,
    check_where_and_how_fast,
    check_whole,
)
from wire.metadata.vocabulary import Handshake, Reason

MAX_COUNT = 100_000_000
MOST_PRIORITY = 255
LATEST_MS = 3_600_000


@dataclass(frozen=True)
class SessionOptions(Options):
    """Address and light of a session; a service adds its own."""

    host: str
    port: int
    block_pairs: int = 16_384  # in a block at most
    rate_hz: int = 50_000_000  # of the source
    source: str = ""  # host that makes the pairs, perhaps the one that asks; "": the network's
    priority: int = 0  # among those that wait for light, if the controller's policy heeds it
    deadline_ms: int = 0  # of the network, until light is wanted at the latest; 0: no deadline

    def asked(self) -> dict[str, Any]:
        """Return the fields of the set-up message that say this."""
        return {
            "handshake": Handshake.FRAMED,
            "pairs": self.block_pairs,
            "frame_bytes": 1,
            "rate_hz": self.rate_hz,
            "port": self.port,
            "priority": self.priority,
            "deadline_ms": self.deadline_ms,
        }

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        check_whole("block_pairs", self.block_pairs, 1, MAX_BLOCK_PAIRS)
        check_whole("priority", self.priority, 0, MOST_PRIORITY)
        check_whole("deadline_ms", self.deadline_ms, 0, LATEST_MS)
        if not isinstance(self.source, str):
            raise SessionError(Reason.UNSUPPORTED, f"source {self.source!r} is not a name")
        check_where_and_how_fast(self.host, self.port, self.rate_hz)
        check_block_time(self.pairs_at_a_time, self.block_pairs, self.rate_hz)

    @property
    def pairs_at_a_time(self) -> int:
        """Return how many pairs a block has at most."""
        return self.block_pairs


@dataclass(frozen=True)
class ServiceOptions(SessionOptions):
    """Those of a session that is about a number of things."""

    MOST: ClassVar[int] = MAX_COUNT  # of these in one session
    count: int = 10_000  # of what the service is about, as states or pairs

    @property
    def fidelity_ppm(self) -> int:
        """Return the pair fidelity wanted at least; 0 is any."""
        return 0

    def asked(self) -> dict[str, Any]:
        """Return the fields of the set-up message that say this."""
        return {**super().asked(), "fidelity_ppm": self.fidelity_ppm}

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        check_whole("count", self.count, 1, self.MOST)
        super().check()

    @property
    def pairs_at_a_time(self) -> int:
        """Return how many pairs a block has at most."""
        return min(self.block_pairs, self.count)
