"""Time tags as the timestamp cards of S-Fifteen write them, and its qcrypto programs read them.

    63                                            14          3         0
    +---------------------------------------------+-----------+---------+
    | time, in 125 ps: 49 bits                    | 0         | pattern |
    +---------------------------------------------+-----------+---------+

Each word is two of 32 bits, the high one first, both little-endian. Times begin again after
2^49 units, 19.5 hours; a bit of the pattern is a detector. The format is section 0 of filespec.txt
in https://github.com/s-fifteen-instruments/qcrypto.
"""

import numpy as np
from numpy.typing import NDArray

from wire.malformed import MalformedPacket

UNIT_PS = 125
TIME_BITS, PATTERN_BITS, TIME_SHIFT = 49, 4, 15
WORD_BYTES = 8
WRAP = 1 << TIME_BITS  # units

Units = NDArray[np.int64]  # of 125 ps
Patterns = NDArray[np.uint8]


def encode(units: Units, patterns: Patterns) -> bytes:
    """Return tags as bytes; both shape (m,)."""
    words = (units % WRAP).astype(np.uint64) << np.uint64(TIME_SHIFT) | patterns
    halves = np.stack([words >> np.uint64(32), words & np.uint64(0xFFFF_FFFF)], axis=1)
    return halves.astype("<u4").tobytes()


def decode(data: bytes) -> tuple[Units, Patterns]:
    """Return times, which go on where the words begin again, and patterns; shape (m,).

    Raise MalformedPacket for bytes that a card never writes.
    """
    if len(data) % WORD_BYTES:
        raise MalformedPacket(f"{len(data)} bytes are not tags of {WORD_BYTES} each")
    halves = np.frombuffer(data, "<u4").reshape(-1, 2).astype(np.uint64)
    words = halves[:, 0] << np.uint64(32) | halves[:, 1]
    patterns = (words & np.uint64((1 << PATTERN_BITS) - 1)).astype(np.uint8)
    if not patterns.all():
        raise MalformedPacket(f"tag {int(patterns.argmin())} is of no detector")
    if (words >> np.uint64(PATTERN_BITS) & np.uint64((1 << TIME_SHIFT - PATTERN_BITS) - 1)).any():
        raise MalformedPacket("tags with bits between time and detectors")
    units = (words >> np.uint64(TIME_SHIFT)).astype(np.int64)
    steps = np.diff(units)
    begins_again = steps < -WRAP // 2
    if (steps[~begins_again] < 0).any():
        raise MalformedPacket("tags whose times do not ascend")
    units[1:] += np.cumsum(begins_again) * WRAP
    return units, patterns
