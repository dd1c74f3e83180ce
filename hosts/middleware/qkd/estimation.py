"""Parameter estimation: disclose a random sample of the sifted key, count its errors."""

from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.qkd.bits import Bits, Mask
from hosts.middleware.qkd.public_randomness import subset


@dataclass(frozen=True)
class Estimate:
    """Errors found in a disclosed sample of the sifted key."""

    errors: int
    sample: int
    ones: int = 0  # of alice's bits of it

    @property
    def qber(self) -> float:
        return self.errors / self.sample

    def beside(self, other: "Estimate") -> "Estimate":
        sums = self.errors + other.errors, self.sample + other.sample, self.ones + other.ones
        return Estimate(*sums)

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


def sample_size(sifted: int, fraction: float) -> int:
    """Return how many of the sifted bits to disclose; 0 if that would leave none."""
    size = max(1, round(sifted * fraction))
    return size if size < sifted else 0


def sample_mask(seed: bytes, sifted: int, sample: int) -> Mask:
    """Return which sifted bits are disclosed, every subset of the size being as likely."""
    return subset(seed, "sample", sifted, sample)


def compare(mine: Bits, theirs: Bits) -> Estimate:
    """Count errors in a disclosed sample of alice's; ValueError if there is nothing to compare."""
    if mine.size == 0 or mine.shape != theirs.shape:
        raise ValueError(f"samples of {mine.size} and {theirs.size} bits cannot be compared")
    errors, ones = np.count_nonzero(mine != theirs), np.count_nonzero(mine)
    return Estimate(int(errors), mine.size, int(ones))
