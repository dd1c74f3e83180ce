"""Limits of what a caller may ask of Sabot, checked before anything is changed."""

import numpy as np
from numpy.typing import NDArray

from dispatcher.refusal import invalid
from dispatcher.sabot.backend import Bytes

MAX_COUNT = 4_000_000


MAX_GATES = 256


def packed(field: str, values: bytes, count: int, largest: int) -> Bytes:
    """Return the bytes of a field that has one for each photon."""
    if len(values) != count:
        raise invalid(f"{field} has {len(values)} bytes for {count} photons; send one for each")
    array = np.frombuffer(values, dtype=np.uint8)
    if array.max() > largest:
        position = int(array.argmax())
        raise invalid(
            f"{field}[{position}] is {array[position]}; each must be between 0 and {largest}"
        )
    return array


def require_positions(field: str, array: NDArray[np.uint32], size: int) -> None:
    """Refuse positions unless they are in a block of this size, and all different."""
    outside = np.flatnonzero(array >= size)
    if outside.size:
        index = int(outside[0])
        raise invalid(f"{field}[{index}] is {array[index]}; count {size} photons from 0")
    counts = np.bincount(array, minlength=1)
    if counts.max() > 1:
        raise invalid(f"{field} name {int(counts.argmax())} twice; name each once")


def require_count(count: int) -> None:
    """Refuse an empty or too large block."""
    if not 1 <= count <= MAX_COUNT:
        raise invalid(f"count {count} is not between 1 and {MAX_COUNT}; make several blocks")
