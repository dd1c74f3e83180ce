"""Intercept and resend: a fraction is measured in Z or X, at random, and sent on as found."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hosts.hardware.qnic import LEFT_ALONE, BlockName, Qnic, Symbols
from hosts.middleware.services.interception.attack import choices
from wire.outcomes import NO_COINCIDENCE

BASES = ("Z", "X")


@dataclass
class Seen:
    """What was seen so far."""

    measured: int = 0  # places that were looked at
    zeros: int = 0
    ones: int = 0


class InterceptResend:
    """Measures a fraction of the photons."""

    def __init__(self, qnic: Qnic, fraction: float, seeds: tuple[int, ...]) -> None:
        self._qnic, self._fraction, self._seeds = qnic, fraction, seeds
        self._seen = Seen()

    @property
    def summary(self) -> dict[str, Any]:
        """What was seen so far."""
        return asdict(self._seen)

    async def attack(self, block: BlockName, photons: int) -> dict[str, Any]:
        """Measure photons of a block and put new ones in their places."""
        bases = self._choose(block, photons)
        outcomes = np.full(bases.size, NO_COINCIDENCE, dtype=np.uint8)
        if (bases != LEFT_ALONE).any():
            outcomes = await self._qnic.resend(block, bases)
        zeros, ones = (int(np.count_nonzero(outcomes == bit)) for bit in (0, 1))
        self._seen.measured += int(np.count_nonzero(bases != LEFT_ALONE))
        self._seen.zeros += zeros
        self._seen.ones += ones
        return {"zeros": zeros, "ones": ones}

    async def end(self) -> None:
        """Let go of nothing: what was measured is gone."""

    def _choose(self, block: BlockName, photons: int) -> Symbols:
        """Return a basis for each photon."""
        random = choices(self._seeds, block)
        chosen = random.random(photons) < self._fraction
        bases = random.integers(0, len(BASES), photons, dtype=np.uint8)
        return np.where(chosen, bases, LEFT_ALONE).astype(np.uint8)
