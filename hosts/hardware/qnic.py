"""What the middleware may ask of a QNIC, whatever stands behind it.

Blocks of k photons are named as on the wire: (session, number, half). A driver for real
equipment implements the same calls (paper, section "Host Nodes").
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Symbols = NDArray[np.uint8]
NO_COINCIDENCE = 255


class HardwareError(Exception):
    """The hardware refused or failed; the text names the value and the remedy."""


class NoLight(HardwareError):
    """No photon of a block arrived in time."""


@dataclass(frozen=True)
class BlockName:
    """k photons: half 0 or 1 of the pairs of one block of a session."""

    session: int
    number: int
    half: int


@dataclass(frozen=True)
class Coincidences:
    """What the Bell analyser reports for a block: Bell states, 255 where it saw none."""

    outcomes: Symbols  # shape (k,): 0 Phi+, 1 Psi+, 2 Phi-, 3 Psi-
    clicks: int
    time_ns: int


class Qnic(Protocol):
    """The light ports of a host and its source, modulators and detectors."""

    @property
    def ports(self) -> list[str]:
        """Interface names of the fibres, in order."""

    async def create_pairs(self, session: int, number: int, count: int) -> None:
        """Make count Bell pairs Phi+: halves 0 and 1 of a block."""

    async def apply(self, block: BlockName, paulis: Symbols) -> None:
        """Apply one Pauli operator (two bits: X, Z) to each photon; shape (k,)."""

    async def send(self, launches: list[tuple[BlockName, str]], rate_hz: int) -> int:
        """Launch blocks into ports; return when the last photon has reached the far end.

        The result is the time (ns) at which the first photon left.
        """

    async def receive(self, block: BlockName, port: str, timeout_s: float) -> None:
        """Take a block that arrives at a port; raise NoLight if none comes in time."""

    async def bell_measure(self, first: BlockName, second: BlockName) -> Coincidences:
        """Measure pairs of photons in the Bell basis; both blocks are gone afterwards."""

    async def discard(self, session: int) -> None:
        """Let go of all photons of a session."""

    async def discard_block(self, block: BlockName) -> None:
        """Let go of a block, if it is here."""
