"""Public randomness: permutations and matrices that both ends derive from one seed.

Only choices whose secrecy does not matter come from here: the order of bits in a pass of
error correction, and the test sample, whose seed is drawn and sent when all light has been
measured. SHAKE-256 (FIPS 202) makes the same numbers on every machine.
"""

import hashlib

import numpy as np

from hosts.middleware.qkd.bits import Indices

SEED_BYTES = 32


def permutation(seed: bytes, purpose: str, size: int) -> Indices:
    """Return a permutation of range(size), uniform for a uniform seed, one for each purpose."""
    if len(seed) != SEED_BYTES:
        raise ValueError(f"a seed has {SEED_BYTES} bytes, not {len(seed)}")
    words = hashlib.shake_256(seed + purpose.encode()).digest(8 * size)
    return np.argsort(np.frombuffer(words, dtype="<u8"), kind="stable").astype(np.int64)
