"""Sifting: keep the photons that both ends saw, in the same basis.

One end announces which photons it detected and in which bases, never the outcomes; the other
answers which of those it keeps. In BB84 the end that prepared the light answers, so that its
bases are disclosed only after the measurement; in BBM92 either may.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from applications.qkd.bell_test import BellOutcomes
from applications.qkd.bits import Bits, Indices, Mask
from wire.keyed import KeyedChoices
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
    def has_levels(self) -> bool:
        return self.levels is not None

    @property
    def clicked(self) -> Indices:
        """Which photons were detected (or prepared)."""
        return np.flatnonzero(self.outcomes != NO_CLICK)

    def of(self, photons: Indices) -> "Record":
        levels = None if self.levels is None else self.levels[photons]
        return Record(self.bases[photons], self.outcomes[photons], levels)


@dataclass(frozen=True)
class Prepared:
    """The same of light that was prepared as a key has chosen."""

    choices: KeyedChoices
    tests: None = None

    @property
    def photons(self) -> int:
        return self.choices.count

    @property
    def has_levels(self) -> bool:
        return bool(self.choices.shares)

    def of(self, photons: Indices) -> Record:
        states, bit = self.choices.states(photons), np.uint8(1)
        return Record(states >> bit, states & bit, self.choices.levels(photons))


@dataclass(frozen=True)
class Clicks:
    """The same of photons that were measured, of which these were detected."""

    photons: int
    clicked: Indices
    detected: Record  # one place for each of these
    tests: None = None
    has_levels: bool = False

    def of(self, photons: Indices) -> Record:
        """Return what is known of photons; one that was not detected has the basis 0."""
        if np.array_equal(photons, self.clicked):
            return self.detected
        seen = np.isin(photons, self.clicked)
        rows = self.clicked.searchsorted(photons[seen])
        bases, outcomes = np.zeros((2, photons.size), np.uint8)
        bases[seen], outcomes[~seen] = self.detected.bases[rows], NO_CLICK
        outcomes[seen] = self.detected.outcomes[rows]
        return Record(bases, outcomes)


Announced = Record | Clicks  # of an end that has measured
Known = Announced | Prepared


def choose(mine: Record, bases: Bits) -> Mask:
    """Return which photons to keep, of those that the other end has detected, in these bases."""
    kept: Mask = (mine.bases == bases) & (mine.outcomes != NO_CLICK)
    return kept
