"""Bit strings: arrays of 0 and 1 here, packed bytes (first bit highest) on the wire."""

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.uint8]  # every element 0 or 1
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]

NO_BITS: Bits = np.empty(0, dtype=np.uint8)


def pack(bits: Bits | Mask) -> bytes:
    """Return bits as bytes, first bit highest, padded with zeros."""
    return np.packbits(bits).tobytes()


def unpack(data: bytes, count: int) -> Bits:
    """Return the first count bits of data; ValueError if data is not as long as they need."""
    if len(data) != (count + 7) // 8:
        raise ValueError(f"{count} bits are packed in {(count + 7) // 8} bytes, not {len(data)}")
    return np.unpackbits(np.frombuffer(data, dtype=np.uint8), count=count)


def pack_levels(levels: Bits) -> bytes:
    """Return numbers from 0 to 3 as bytes, two bits each."""
    return pack(np.stack([levels >> 1, levels & 1], axis=1).reshape(-1))


def unpack_levels(data: bytes, count: int) -> Bits:
    """Return the first count numbers from 0 to 3; ValueError if data is of another length."""
    bits = unpack(data, 2 * count)
    return bits[::2] << np.uint8(1) | bits[1::2]
