"""Random numbers by key and position: any of them without those before it.

Two rounds of the finaliser of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), each under half of the
key. Two programs draw the same numbers by one key.
"""

import numpy as np
from numpy.typing import NDArray

KEY_BYTES = 16
STEP = np.uint64(0x9E3779B97F4A7C15)
FACTORS = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
FRACTION = np.uint64(11)  # bits of a word that a float does not hold

Words = NDArray[np.uint64]


def words(key: bytes, at: NDArray[np.int64] | Words) -> Words:
    """Return 64 random bits for each position, shape (k,)."""
    value = at.astype(np.uint64)
    for half in np.frombuffer(key, "<u8"):
        value *= STEP
        value += half
        for factor, shift in zip(FACTORS, SHIFTS, strict=False):
            value ^= value >> shift
            value *= factor
        value ^= value >> SHIFTS[2]
    return value


def uniform(key: bytes, at: NDArray[np.int64] | Words) -> NDArray[np.float64]:
    """Return a number from [0, 1) for each position, shape (k,)."""
    return np.asarray((words(key, at) >> FRACTION) * 2.0**-53, np.float64)


def identities(at: NDArray[np.int64], fates: NDArray[np.float64]) -> Words:
    """Return a number for each photon, of its pulse and a number that it alone has there."""
    return words(bytes(KEY_BYTES), at) ^ fates.view(np.uint64)
