"""Privacy amplification: a Toeplitz matrix over GF(2) shortens the key (Krawczyk 1994).

Bit i of the result is the sum over j of seed[i - j + n - 1] key[j], modulo 2: a convolution,
done by FFT. The sums are integers below 2**22 and the error of the transform some 1e-8 of
one; that they came out as integers is checked.
"""

from collections.abc import Iterator

import numpy as np

from hosts.middleware.qkd.bits import NO_BITS, Bits

MAX_ROUNDING = 0.1


def seed_bits(key_bits: int, length: int) -> int:
    """Return how many random bits choose the matrix."""
    return key_bits + length - 1


def toeplitz(key: Bits, seed: Bits, length: int) -> Bits:
    """Return length bits; two-universal for a uniform seed of key.size + length - 1 bits."""
    if not 0 <= length <= key.size:
        raise ValueError(f"{length} bits cannot be made of {key.size}")
    if length == 0:
        return NO_BITS
    if seed.size != seed_bits(key.size, length):
        raise ValueError(f"a seed of {seed.size} bits, not {seed_bits(key.size, length)}")
    size = _fast_size(seed.size)  # what wraps around falls on bits that are not used
    product = np.fft.irfft(np.fft.rfft(key, size) * np.fft.rfft(seed, size), size)
    sums = product[key.size - 1 : seed.size]
    rounded = np.rint(sums)
    if np.abs(sums - rounded).max() > MAX_ROUNDING:
        raise ArithmeticError(f"the transform of {size} points was not exact")
    return (rounded.astype(np.int64) & 1).astype(np.uint8)


def _fast_size(least: int) -> int:
    """Return the smallest even 2**a 3**b 5**c that is not below least: an FFT of it is fast."""
    odd: Iterator[int] = (3**b * 5**c for b in range(14) for c in range(10))
    return min(factor << max(1, (-(-least // factor) - 1).bit_length()) for factor in odd)
