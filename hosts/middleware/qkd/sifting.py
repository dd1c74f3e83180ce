"""Sifting: keep the photons that both ends saw, in the same basis.

One end announces which photons it detected and in which bases, never the outcomes; the other
answers which of those it keeps. In BB84 the end that prepared the light answers, so that its
bases are disclosed only after the measurement; in BBM92 either may.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.qkd.bell_test import BellOutcomes
from hosts.middleware.qkd.bits import Bits, Indices, Mask
from wire.outcomes import NO_CLICK


@dataclass(frozen=True)
class Record:
    """One end's knowledge of a block of photons: bases (0 or 1) and outcomes, both uint8.

    An outcome is 0, 1 or NO_CLICK; an end that prepared the light gives the bits it sent.
    """

    bases: Bits
    outcomes: NDArray[np.uint8]
    levels: Bits | None = None  # of an end that prepared light of several intensities: which
    # Of bob, where a CHSH test decides; these photons have no outcome above.
    tests: BellOutcomes | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.bases.shape != self.outcomes.shape or self.bases.ndim != 1:
            raise ValueError(
                f"bases of shape {self.bases.shape}, outcomes of shape {self.outcomes.shape}: "
                "give one of each for every photon"
            )
        if (self.bases > 1).any():
            raise ValueError("a basis is 0 or 1")
        if ((self.outcomes > 1) & (self.outcomes != NO_CLICK)).any():
            raise ValueError(f"an outcome is 0, 1 or {NO_CLICK} (no click)")

    @property
    def photons(self) -> int:
        return self.bases.size

    @property
    def clicked(self) -> Mask:
        """Which photons were detected (or prepared)."""
        return np.not_equal(self.outcomes, NO_CLICK)


def choose(mine: Record, clicked: Indices, bases: Bits) -> Mask:
    """Return which photons to keep, given which the other end detected, and in which bases.

    `bases` has one element for each click. The answer has one for each click as well.
    """
    kept: Mask = np.logical_and(mine.bases[clicked] == bases, mine.clicked[clicked])
    return kept


def places(clicked: Indices, kept: Mask) -> Indices:
    return clicked[np.flatnonzero(kept)]
