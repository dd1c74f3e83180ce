"""The choices of an application for superdense coding."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import (
    MAX_BLOCK_PAIRS,
    MAX_FRAME_BYTES,
    MIN_BLOCK_PAIRS,
    check_choice,
    check_whole,
)
from hosts.middleware.session.service_options import SessionOptions
from hosts.timeouts import MAX_BLOCK_S
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import FEC_NAMES, Handshake, Reason, Service

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

    block_pairs: int = DEFAULT_BLOCK_PAIRS  # or what slower light makes in MAX_BLOCK_S
    handshake: str = "framed"
    frame_bytes: int = 256
    fec: str = "none"  # error-correction code, one of FEC_NAMES
    interleave: bool = False  # let the bits of its codewords travel far from each other

    def asked(self) -> dict[str, Any]:
        """Return the fields of the set-up message that say this."""
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
        """Raise SessionError for a value out of range."""
        check_choice("handshake", self.handshake, HANDSHAKES)
        check_choice("fec", self.fec, FEC_NAMES)
        if not isinstance(self.interleave, bool):
            text = f"interleave {self.interleave!r}: choose True or False"
            raise SessionError(Reason.UNSUPPORTED, text)
        check_whole("frame_bytes", self.frame_bytes, 1, MAX_FRAME_BYTES)
        check_whole("block_pairs", self.block_pairs, MIN_BLOCK_PAIRS, MAX_BLOCK_PAIRS)
        super().check()


def sent_half(setup: Setup) -> int:
    """Return which half of each pair comes to the sender, by its first fibre."""
    return int(setup.service == Service.SDC_RETURN)


def arrival_ports(setup: Setup, ports: Sequence[str]) -> tuple[str, str]:
    """Return where halves 0 and 1 arrive at the receiver.

    What the sender passes on comes by the second fibre, the other half by the first one.
    """
    first, second = ports[:2]
    return (second, first) if sent_half(setup) == 0 else (first, second)
