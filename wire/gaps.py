"""Ascending positions by the gaps between them, in the fewest bits.

    0       1          5
    +-------+----------+----------------------+----------------------+
    | shift | bits     | high parts, in unary | low parts            |
    +-------+----------+----------------------+----------------------+

Rice coding (JPL Technical Report 32-1529, 1971): of each gap less 1, the bits above `shift` are as
many zeros and then a one, those below are written as they are. Without a shift the high parts are
a mask with a bit for each place. Both are packed, the first bit highest; their padding is 0.
"""

import struct

import numpy as np
from numpy.typing import NDArray

HEAD = struct.Struct("!BI")
MOST_SHIFT = 32
GAP_OF_A_SHIFT = 2.078  # 1 / ln of the golden ratio (Kiely, IPN Progress Report 42-159, 2004)

Positions = NDArray[np.int64]


def encode(positions: Positions) -> bytes:
    """Return positions, which ascend from 0, as bytes; none are no bytes."""
    if not positions.size:
        return b""
    mean = (int(positions[-1]) + 1) / positions.size
    shift = 0
    while mean > GAP_OF_A_SHIFT * 2**shift:
        shift += 1
    ones, low = positions, np.zeros(0, np.uint8)
    if shift:
        gaps = np.diff(positions, prepend=-1) - 1
        ones = ((gaps >> shift) + 1).cumsum() - 1
        low = (gaps[:, None] >> np.arange(shift - 1, -1, -1)).astype(np.uint8) & np.uint8(1)
    high = np.zeros(int(ones[-1]) + 1, np.uint8)
    high[ones] = 1
    return HEAD.pack(shift, high.size) + np.packbits(high).tobytes() + np.packbits(low).tobytes()


def decode(data: bytes, places: int) -> Positions:
    """Return the positions, below `places`; raise ValueError for bytes that are not of any."""
    if not data:
        return np.zeros(0, np.int64)
    if len(data) < HEAD.size:
        raise ValueError(f"{len(data)} bytes of gaps are too few")
    shift, bits = HEAD.unpack_from(data)
    if shift > MOST_SHIFT:
        raise ValueError(f"gaps are shifted by {shift} bits, more than {MOST_SHIFT}")
    middle = HEAD.size + (bits + 7) // 8
    positions: Positions = np.flatnonzero(_bits(data[HEAD.size : middle], bits))
    if not positions.size or positions[-1] != bits - 1:
        raise ValueError("gaps do not end with one")
    low = _bits(data[middle:], positions.size * shift).reshape(positions.size, shift)
    if shift:
        gaps = (np.diff(positions, prepend=-1) - 1) << shift
        for column in range(shift):
            gaps |= low[:, column].astype(np.int64) << (shift - 1 - column)
        if int(gaps.max()) >= places:
            raise ValueError(f"a gap of {int(gaps.max()) + 1} in {places} places")
        positions = (gaps + 1).cumsum() - 1
    if positions[-1] >= places:
        raise ValueError(f"position {positions[-1]} is not below {places}")
    return positions


def _bits(data: bytes, count: int) -> NDArray[np.bool_]:
    if len(data) != (count + 7) // 8:
        raise ValueError(f"{len(data)} bytes of gaps for {count} bits")
    bits = np.unpackbits(np.frombuffer(data, np.uint8)).view(np.bool_)
    if bits[count:].any():
        raise ValueError("bits are set behind the last gap")
    return bits[:count]
