"""Random numbers by key and position: any of them without those before it.

Two rounds of the finaliser of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), each under half of the
key. Two programs draw the same numbers by one key.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

KEY_BYTES = 16
STEP = np.uint64(0x9E3779B97F4A7C15)
FACTORS = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
CACHED = 1 << 15  # words that stay in a processor's cache while they are drawn
FRACTION = np.uint64(11)  # bits of a word that a float does not hold

Words = NDArray[np.uint64]


def words(key: bytes, at: NDArray[np.int64] | Words) -> Words:
    """Return 64 random bits for each position, shape (k,)."""
    value = at.astype(np.uint64)
    for start in range(0, value.size, CACHED):
        part = value[start : start + CACHED]
        for half in np.frombuffer(key, "<u8"):
            part *= STEP
            part += half
            for factor, shift in zip(FACTORS, SHIFTS, strict=False):
                part ^= part >> shift
                part *= factor
            part ^= part >> SHIFTS[2]
    return value


def uniform(key: bytes, at: NDArray[np.int64] | Words) -> NDArray[np.float64]:
    """Return a number from [0, 1) for each position, shape (k,)."""
    return np.asarray((words(key, at) >> FRACTION) * 2.0**-53, np.float64)


def identities(at: NDArray[np.int64], fates: NDArray[np.float64]) -> Words:
    """Return a number for each photon, of its pulse and a number that it alone has there."""
    return words(bytes(KEY_BYTES), at) ^ fates.view(np.uint64)


@dataclass(frozen=True)
class KeyedChoices:
    """The state of each pulse, and its level of intensity, as a host chooses them at random."""

    key: bytes
    count: int  # pulses
    shares: tuple[float, ...] = ()  # of the levels; empty: all have one

    @property
    def places(self) -> int:
        """How many of them are kept: none."""
        return 0

    def states(self, at: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return 0 to 3, for |0>, |1>, |+> and |->, of pulses; shape (m,)."""
        return (words(self.key, at) & np.uint64(3)).astype(np.uint8)

    def bases(self, at: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Return the bases of these states: 0 Z, 1 X."""
        return self.states(at) >> np.uint8(1)

    def levels(self, at: NDArray[np.int64]) -> NDArray[np.uint8] | None:
        """Return the level of each of these pulses; None if all have one."""
        if not self.shares:
            return None
        bounds = np.cumsum(self.shares)[:-1]
        return bounds.searchsorted(uniform(self.key, at), side="right").astype(np.uint8)

    def mean(self, values: NDArray[np.float64]) -> float:
        """Return the mean over all pulses of a value that each level has."""
        return float(np.dot(self.shares or (1.0,), values[: len(self.shares) or 1]))
