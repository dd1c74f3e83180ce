"""The fidelity of pairs to Phi+, estimated by measuring some of them in equal bases at both ends.

F = (1 + <XX> - <YY> + <ZZ>) / 4: of Phi+ the outcomes agree in X and Z and differ in Y.
"""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.qnic import Symbols

BASES = ("Z", "X", "Y")  # numbered as in wire/dispatcher.proto
DIFFER = 2  # the basis in which the halves of Phi+ give different outcomes
NORMAL_95 = 1.959964  # 95 % of a normal distribution is within so many standard deviations


@dataclass
class Estimate:
    """What has been measured so far, by basis."""

    measured: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))
    right: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))  # as of Phi+

    def add(self, bases: Symbols, ours: Symbols, theirs: Symbols) -> None:
        """Count pairs: their basis and the outcomes at both ends, above 1 where there was none."""
        clicked = (ours <= 1) & (theirs <= 1)
        right = clicked & ((ours != theirs) == (bases == DIFFER))
        self.measured += np.bincount(bases[clicked], minlength=3)
        self.right += np.bincount(bases[right], minlength=3)

    @property
    def total(self) -> int:
        """Return how many pairs were measured."""
        return int(self.measured.sum())

    @property
    def fidelity(self) -> float | None:
        """Return the estimate, from 0 to 1; None while a basis has no outcome."""
        if not self.measured.all():
            return None
        return _from_shares(self.right / self.measured)

    @property
    def interval(self) -> tuple[float, float] | None:
        """Return the 95 % confidence interval; None while a basis has no outcome.

        The Wilson score intervals of the three shares of right outcomes (Wilson, J. Am. Stat.
        Assoc. 22, 209, 1927), joined to that of their sum by the method of variance estimates
        recovery (Zou and Donner, Stat. Med. 27, 1693, 2008). Of a perfect sample, too, it has a
        width.
        """
        if not self.measured.all():
            return None
        shares = self.right / self.measured
        lows, highs = _wilson(shares, self.measured)
        fidelity = (float(shares.sum()) - 1) / 2
        low = fidelity - sqrt(float(((shares - lows) ** 2).sum())) / 2
        high = fidelity + sqrt(float(((highs - shares) ** 2).sum())) / 2
        return max(low, 0.0), min(high, 1.0)


def _from_shares(right: NDArray[np.float64]) -> float:
    """Return F, given the share of right outcomes in each basis: each <..> is 2 share - 1."""
    return min(max((float(right.sum()) - 1) / 2, 0.0), 1.0)


def _wilson(
    shares: NDArray[np.float64], counts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    square = NORMAL_95**2
    middle = (shares + square / (2 * counts)) / (1 + square / counts)
    spread = shares * (1 - shares) / counts + square / (4 * counts**2)
    half = NORMAL_95 * np.sqrt(spread) / (1 + square / counts)
    return middle - half, middle + half
