"""Options of every service, checked before anything is sent."""

from dataclasses import dataclass

from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.options import (
    MAX_BLOCK_PAIRS,
    Options,
    check_block_time,
    check_where_and_how_fast,
    check_whole,
)
from wire.metadata import Reason


@dataclass(frozen=True)
class ServiceOptions(Options):
    """Address and packetisation; a service adds its own."""

    host: str
    port: int
    count: int = 10_000  # of what the service is about, as states or pairs
    block_pairs: int = 16_384  # in a block at most
    rate_hz: int = 50_000_000  # of the source
    source: str = ""  # host that makes the pairs, perhaps the one that asks; "": the network's

    @property
    def fidelity_ppm(self) -> int:
        """Return the pair fidelity wanted at least; 0 is any."""
        return 0

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        check_whole("count", self.count, 1, 100_000_000)
        check_whole("block_pairs", self.block_pairs, 1, MAX_BLOCK_PAIRS)
        if not isinstance(self.source, str):
            raise SessionError(Reason.UNSUPPORTED, f"source {self.source!r} is not a name")
        check_where_and_how_fast(self.host, self.port, self.rate_hz)
        check_block_time(min(self.block_pairs, self.count), self.block_pairs, self.rate_hz)
