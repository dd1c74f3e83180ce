"""A regular low-density parity-check code of any size, drawn from a public seed.

Every bit of the key is in three checks, every check has about as many bits as any other
(Gallager 1962). A code is the array of the three checks of each bit.
"""

import numpy as np

from hosts.middleware.qkd.bits import Bits, Indices
from hosts.middleware.qkd.public_randomness import permutation

ROWS_OF_A_BIT = 3
LEAST_CHECKS = 8  # with fewer, three different rows may not be found


def rows(seed: bytes, bits: int, checks: int) -> Indices:
    """Return the checks that each bit is in, shape (bits, 3), three different ones each."""
    if checks < LEAST_CHECKS:
        raise ValueError(f"{checks} checks, at least {LEAST_CHECKS}")
    code = permutation(seed, f"ldpc {checks}", bits * ROWS_OF_A_BIT).reshape(bits, -1) % checks
    while True:
        twice = (code == np.roll(code, 1, axis=1)).any(axis=1)
        if not twice.any():
            return code
        code[twice] = (code[twice] + np.arange(ROWS_OF_A_BIT)) % checks


def syndrome(key: Bits, code: Indices, checks: int) -> Bits:
    ones = np.bincount(code[key == 1].ravel(), minlength=checks)
    return (ones & 1).astype(np.uint8)
