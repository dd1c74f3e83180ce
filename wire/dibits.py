"""Numbers of two bits, four to a byte: the first in its highest bits ("big") or lowest ("little").

Bits behind the last number are 0. In order "big" they are bytes as these are read.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

PER_BYTE = 4
LARGEST = np.uint8(3)
_EVERY_BYTE = np.arange(256, dtype=np.uint8)[:, None]
_SHIFTS = {
    "big": np.array([6, 4, 2, 0], dtype=np.uint8),
    "little": np.array([0, 2, 4, 6], dtype=np.uint8),
}
# The four numbers of each byte, as one number of 32 bits.
_NUMBERS = {
    order: (_EVERY_BYTE >> shifts & LARGEST).view(np.uint32) for order, shifts in _SHIFTS.items()
}
# How often each number is in each byte.
_COUNTS = (_NUMBERS["big"].view(np.uint8)[:, :, None] == np.arange(4)).sum(axis=1)
# Brings four numbers, each in a byte of its own, side by side into the highest of these bytes.
_GATHER = {
    "big": np.uint32(1 << 30 | 1 << 20 | 1 << 10 | 1),
    "little": np.uint32(1 << 24 | 1 << 18 | 1 << 12 | 1 << 6),
}

Numbers = NDArray[np.uint8]
Order = Literal["big", "little"]


def length(count: int) -> int:
    """Return how many bytes hold this number of dibits."""
    return -(-count // PER_BYTE)


def pack(numbers: Numbers, order: Order = "big") -> bytes:
    """Return numbers, each 0 to 3, shape (k,), as length(k) bytes."""
    size = length(numbers.size) * PER_BYTE
    if size != numbers.size:
        numbers = np.concatenate([numbers, np.zeros(size - numbers.size, dtype=np.uint8)])
    words = np.ascontiguousarray(numbers).view("<u4") * _GATHER[order]
    return (words >> np.uint32(24)).astype(np.uint8).tobytes()


def unpack(packed: bytes, count: int, order: Order = "big") -> Numbers:
    """Return the first count numbers of packed ones, shape (count,).

    Raise ValueError if there are not just as many bytes as hold them, or bits behind the last.
    """
    if len(packed) != length(count):
        raise ValueError(f"{len(packed)} bytes for {count} numbers of two bits")
    numbers = _NUMBERS[order][np.frombuffer(packed, dtype=np.uint8)].view(np.uint8).reshape(-1)
    if numbers[count:].any():
        raise ValueError(f"bits are set behind the last of {count} numbers")
    return numbers[:count]


def counts(packed: bytes) -> NDArray[np.int64]:
    """Return how often each number is in bytes that are full of them, shape (4,)."""
    bytes_of_each = np.bincount(np.frombuffer(packed, dtype=np.uint8), minlength=256)
    numbers: NDArray[np.int64] = bytes_of_each @ _COUNTS
    return numbers
