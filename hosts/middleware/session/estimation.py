"""Shares of outcomes, and how far from them the true ones may be."""

from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Estimate:
    """Errors found in a sample."""

    errors: int
    sample: int
    ones: int = 0

    @property
    def qber(self) -> float:
        return self.errors / self.sample

    @property
    def ones_fraction(self) -> float | None:
        return self.ones / self.sample if self.sample else None

    def beside(self, other: "Estimate") -> "Estimate":
        return Estimate(
            self.errors + other.errors, self.sample + other.sample, self.ones + other.ones
        )

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of the error rate (Wilson 1927)."""
        z = NormalDist().inv_cdf((1 + confidence) / 2)
        centre = self.qber + z * z / (2 * self.sample)
        half = z * sqrt(self.qber * (1 - self.qber) / self.sample + (z / (2 * self.sample)) ** 2)
        scale = 1 + z * z / self.sample
        # Without an error, or with nothing else, one end is 0, or 1, but for rounding.
        low = (centre - half) / scale if self.errors else 0.0
        high = (centre + half) / scale if self.errors < self.sample else 1.0
        return low, high


Counts = NDArray[np.int64] | int


def share_variance(right: Counts, seen: Counts) -> NDArray[np.float64]:
    """Return the squared standard error of the share right / seen, by Wilson's score interval.

    It is the half-width for one standard deviation: above 0 also if all outcomes are alike.
    """
    share = np.divide(right, seen)
    return np.asarray((seen * share * (1 - share) + 0.25) / np.square(np.add(seen, 1)))
