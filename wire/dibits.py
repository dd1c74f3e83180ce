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
# Brings four numbers, each in a byte of its own, side by side into the highest of these bytes.
_GATHER = {
    "big": np.uint32(1 << 30 | 1 << 20 | 1 << 10 | 1),
    "little": np.uint32(1 << 24 | 1 << 18 | 1 << 12 | 1 << 6),
}
_WORD = 8  # bytes
_LOW = np.uint64(0x5555_5555_5555_5555)  # the lower bit of each number

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
    require(packed, count, order)
    return _unpacked(packed, order)[:count]


def require(packed: bytes, count: int, order: Order = "big") -> None:
    """Raise ValueError unless these are the bytes of `count` numbers, without bits behind them."""
    if len(packed) != length(count):
        raise ValueError(f"{len(packed)} bytes for {count} numbers of two bits")
    rest = count % PER_BYTE
    if rest and _unpacked(packed[-1:], order)[rest:].any():
        raise ValueError(f"bits are set behind the last of {count} numbers")


def _unpacked(packed: bytes, order: Order) -> Numbers:
    return _NUMBERS[order][np.frombuffer(packed, dtype=np.uint8)].view(np.uint8).reshape(-1)


def at(packed: bytes, positions: NDArray[np.int64], order: Order = "big") -> Numbers:
    """Return the numbers at some positions, shape (m,)."""
    shifts = _SHIFTS[order][positions % PER_BYTE]
    found: Numbers = np.frombuffer(packed, np.uint8)[positions // PER_BYTE] >> shifts & LARGEST
    return found


def scattered(
    positions: NDArray[np.int64], numbers: Numbers, count: int, order: Order = "big"
) -> bytes:
    """Return packed numbers of which those at some positions, all different, are not 0."""
    packed = np.zeros(length(count), np.uint8)
    np.bitwise_or.at(packed, positions // PER_BYTE, numbers << _SHIFTS[order][positions % PER_BYTE])
    return packed.tobytes()


def counts(packed: bytes) -> NDArray[np.int64]:
    """Return how often each number is in bytes that are full of them, shape (4,)."""
    words = np.frombuffer(packed + bytes(-len(packed) % _WORD), np.uint64)
    low, high = words & _LOW, words >> np.uint64(1) & _LOW
    one, two, three = (
        int(np.bitwise_count(bits).sum()) for bits in (low & ~high, high & ~low, low & high)
    )
    return np.array([PER_BYTE * len(packed) - one - two - three, one, two, three])
