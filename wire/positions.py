"""Positions of photons in a block, in any order, as bytes: four each, the lowest first."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FORM = np.dtype("<u4")


def pack(positions: ArrayLike) -> bytes:
    return np.asarray(positions, FORM).tobytes()


def unpack(data: bytes) -> NDArray[np.uint32]:
    """Return the positions; raise ValueError for bytes that are not of any."""
    if len(data) % FORM.itemsize:
        raise ValueError(f"{len(data)} bytes of positions, of {FORM.itemsize} bytes each")
    return np.frombuffer(data, FORM)
