"""The choices of an application for superdense coding."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import (
    MAX_BLOCK_PAIRS,
    MAX_FRAME_BYTES,
    MIN_BLOCK_PAIRS,
    SessionOptions,
)
from hosts.timeouts import MAX_BLOCK_S
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import FEC_NAMES, Handshake, Service
from wire.parameters.option import option

DEFAULT_BLOCK_PAIRS = 131_072
SEQUENTIAL = "sequential"
# As they are called on the wire: whether handshakes wait for each other is the opener's own affair.
HANDSHAKES = {
    "framed": Handshake.FRAMED,
    "per-pair": Handshake.PER_PAIR,
    SEQUENTIAL: Handshake.PER_PAIR,
}


@dataclass(frozen=True)
class SuperdenseOptions(SessionOptions):
    """Packetisation of a session that carries bytes."""

    source: str = ""  # no option: the network's
    # Or what slower light makes in MAX_BLOCK_S.
    block_pairs: int = option(
        DEFAULT_BLOCK_PAIRS,
        f"pairs in a block ({DEFAULT_BLOCK_PAIRS})",
        metavar="N",
        range=(MIN_BLOCK_PAIRS, MAX_BLOCK_PAIRS),
    )
    handshake: str = option("framed", "default: framed", choices=sorted(HANDSHAKES))
    frame_bytes: int = option(
        256, "bytes under one check (256)", metavar="N", range=(1, MAX_FRAME_BYTES)
    )
    fec: str = option("none", "error-correction code (none)", choices=FEC_NAMES)
    # Lets the bits of a codeword travel far from each other.
    interleave: bool = option(False, "spread the codewords of --fec over a frame")

    def asked(self) -> dict[str, Any]:
        return {
            **super().asked(),
            "pairs": self.pairs_at_a_time,
            "handshake": HANDSHAKES[self.handshake],
            "frame_bytes": self.frame_bytes,
            "fec": FEC_NAMES[self.fec],
            "interleave": int(self.interleave),
        }

    @property
    def pairs_at_a_time(self) -> int:
        """Return how many pairs a block has at most; fewer of slow light if none were chosen."""
        if self.block_pairs != DEFAULT_BLOCK_PAIRS:
            return self.block_pairs
        return min(self.block_pairs, max(MIN_BLOCK_PAIRS, int(self.rate_hz * MAX_BLOCK_S)))

    def check(self) -> None:
        super().check()
        if not isinstance(self.interleave, bool):
            raise unsupported(f"interleave {self.interleave!r}: choose True or False")


def sent_half(setup: Setup) -> int:
    return int(setup.service == Service.SDC_RETURN)


def arrival_ports(setup: Setup, ports: Sequence[str]) -> tuple[str, str]:
    """Return where halves 0 and 1 arrive at the receiver.

    The half that the sender passes on comes by the second fibre, the other half by the first one.
    """
    first, second = ports[:2]
    return (second, first) if sent_half(setup) == 0 else (first, second)
