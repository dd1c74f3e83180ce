"""Options of every session, checked before anything is sent."""

from dataclasses import dataclass, field
from typing import Any

from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import (
    MAX_BLOCK_PAIRS,
    MAX_RATE_HZ,
    Options,
    check_block_time,
    check_where,
)
from wire.metadata.vocabulary import Handshake, Reason
from wire.parameters.option import option, recorded_as

MAX_COUNT = 100_000_000
MOST_PRIORITY = 255
LATEST_MS = 3_600_000


@dataclass(frozen=True)
class SessionOptions(Options):
    """Address and light of a session; a service adds its own."""

    host: str = field(metadata=recorded_as("receiver"))  # as users call who is asked
    port: int
    block_pairs: int = option(
        16_384, "pairs in a block (16384)", metavar="N", range=(1, MAX_BLOCK_PAIRS)
    )
    rate_hz: int = option(
        50_000_000, "of the source (50000000)", metavar="HZ", range=(1, MAX_RATE_HZ)
    )
    source: str = option(
        "",
        "host that makes the pairs, perhaps the one that asks (the network's)",
        metavar="HOST",
    )
    # Among those that wait for light, if the controller's policy heeds it.
    priority: int = field(default=0, metadata={"range": (0, MOST_PRIORITY)})
    # Of the network, until light is wanted at the latest; 0: no deadline.
    deadline_ms: int = field(default=0, metadata={"range": (0, LATEST_MS)})

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
        super().check()
        if not isinstance(self.source, str):
            raise SessionError(Reason.UNSUPPORTED, f"source {self.source!r} is not a name")
        check_where(self.host, self.port)
        check_block_time(self.pairs_at_a_time, self.block_pairs, self.rate_hz)

    @property
    def pairs_at_a_time(self) -> int:
        """Return how many pairs a block has at most."""
        return self.block_pairs


@dataclass(frozen=True)
class ServiceOptions(SessionOptions):
    """Those of a session that is about a number of things."""

    count: int = option(
        10_000,
        "of what the service is about, as states or pairs (10000)",
        metavar="N",
        range=(1, MAX_COUNT),
    )

    @property
    def fidelity_ppm(self) -> int:
        """Return the pair fidelity wanted at least; 0 is any."""
        return 0

    def asked(self) -> dict[str, Any]:
        return {**super().asked(), "fidelity_ppm": self.fidelity_ppm}

    @property
    def pairs_at_a_time(self) -> int:
        return min(self.block_pairs, self.count)
