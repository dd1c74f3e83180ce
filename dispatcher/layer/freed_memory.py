"""Keeps memory that has been freed, for the next block, instead of giving it back to the system.

A block of light takes and frees arrays of some megabytes a hundred times. The C library would
give each of them back, and the system clears every page that is taken again: that was more
than half of the time of an ideal block.
"""

import ctypes

M_TRIM_THRESHOLD = -1  # of mallopt(3), from malloc.h
M_MMAP_THRESHOLD = -3
KEPT_BYTES = 256 << 20  # at the end of the heap
LARGEST_BYTES = 32 << 20  # of an array that is kept; the C library takes no more


def keep() -> bool:
    """Keep it from now on, in the whole process; return whether the C library can (musl cannot)."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGEST_BYTES) and mallopt(M_TRIM_THRESHOLD, KEPT_BYTES))
