"""What the middleware may ask of a QNIC, whatever stands behind it.

Blocks of k photons are named as on the wire: (session, number, half). A driver for real
equipment implements the same calls (paper, section "Host Nodes").
"""

import logging
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

log = logging.getLogger("qnic")

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

    async def emit_pairs(
        self,
        session: int,
        number: int,
        count: int,
        ports: tuple[str, str],
        rate_hz: int,
        wavelength_pm: int,
    ) -> None:
        """Make count Bell pairs Phi+ and send their halves 0 and 1 into two ports.

        Return when the last photon has reached the far ends.
        """

    async def modulate(
        self,
        block: BlockName,
        paulis: Symbols,
        port: str,
        rate_hz: int,
        wavelength_pm: int,
        timeout_s: float,
    ) -> int:
        """Apply one Pauli operator (two bits: X, Z) to each photon that arrives; shape (k,).

        The photons leave by the port they came from. Return the time (ns) at which the first
        one left, when the last has reached the far end. Raise NoLight if none arrives.
        """

    async def detect_pairs(
        self, session: int, number: int, ports: tuple[str, str], timeout_s: float
    ) -> Coincidences:
        """Make Bell measurements on the halves 0 and 1 that arrive at two ports.

        Raise NoLight if no photon of a half arrives; what came of the other is let go.
        """

    async def let_go(self, session: int, number: int) -> None:
        """Let go of what has come of both halves of a block."""

    def watch(self, session: int, history: bool) -> AsyncIterator[bytes]:
        """Yield what happens at this host (wire.events), of one session or, with 0, of all.

        History: begin with what is remembered. Raise HardwareError if it cannot go on.
        """

    async def discard(self, session: int) -> None:
        """Let go of all photons of a session, also of those still on their way."""


async def release(qnic: Qnic, session: int) -> None:
    """Let go of a session at its end; a fault here must not hide why it has ended."""
    try:
        await qnic.discard(session)
    except HardwareError as error:
        log.warning("session %016x: %s", session, error)
