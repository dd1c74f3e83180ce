"""Privacy amplification: a modified Toeplitz matrix (T, I) over GF(2) shortens the key.

A key x of n bits becomes l bits: its last l plus T times the others. T has l rows and n - l
columns, element (i, j) is seed[i - j + n - l - 1], and I is the unit matrix: two-universal, with a
seed of n - 1 bits (Hayashi and Tsurumaru, IEEE Trans. Inf. Theory 62, 2213 (2016), after
Krawczyk 1994). The product is a convolution, done by FFT. Its sums are integers below 2**20, two
of them side by side in one number, and the error of the transform is some 1e-4 of one at most; that
they came out as integers is checked.
"""

import numpy as np
from numpy.fft import irfft, rfft

from applications.qkd.bits import NO_BITS, Bits

MAX_ROUNDING = 0.1


def seed_bits(key_bits: int) -> int:
    """Return how many random bits choose the matrix."""
    return key_bits - 1


def fast_size(least: int) -> int:
    """Return the least product of twos, threes and fives that is not less: fast to transform.

    scipy.fft.next_fast_len finds the same, but to import scipy.fft takes twice as long as numpy.
    """
    powers = range(least.bit_length())
    odd: list[int] = [3**i * 5**j for i in powers for j in powers]
    return min(one << (-(-least // one) - 1).bit_length() for one in odd)


def toeplitz(key: Bits, seed: Bits, length: int) -> Bits:
    """Return length bits; two-universal for a uniform seed of key.size - 1 bits."""
    if not 0 <= length <= key.size:
        raise ValueError(f"{length} bits cannot be made of {key.size}")
    if length == 0:
        return NO_BITS
    if seed.size != seed_bits(key.size):
        raise ValueError(f"a seed of {seed.size} bits, not {seed_bits(key.size)}")
    others = key.size - length
    if others == 0:
        return key.copy()
    # The first half of the key and, beyond the reach of any sum, the second: in one transform.
    half, shift = -(-length // 2), others.bit_length()
    size = fast_size(half + others - 1)  # what wraps around falls on bits not used
    both = np.zeros(size)
    both[: half + others - 1] = seed[: half + others - 1]
    both[: seed.size - half] += seed[half:] * np.float64(1 << shift)
    product = rfft(both)
    product *= rfft(key[:others].astype(np.float64), size)
    sums = irfft(product, size)[others - 1 : half + others - 1]
    rounded = np.rint(sums)
    if np.abs(sums - rounded).max() > MAX_ROUNDING:
        raise ArithmeticError(f"the transform of {size} points was not exact")
    whole = rounded.astype(np.int64)
    halves = whole & 1, (whole >> shift)[: length - half] & 1
    result: Bits = np.concatenate(halves).astype(np.uint8) ^ key[others:]
    return result
