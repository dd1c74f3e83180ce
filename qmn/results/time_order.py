"""Packets of several captures in the order of time, in memory that does not grow with their number.

The place of each packet is noted in 40 bytes; notes are sorted in batches, each put into a file,
and the sorted parts are then read beside each other.
"""

import heapq
import struct
from collections.abc import Iterable, Iterator
from itertools import islice, pairwise
from typing import IO, NamedTuple

# Big-endian, so that the bytes of notes sort as their fields do.
NOTE = struct.Struct("!QQIIQII")
SORTED_AT_ONCE = 50_000  # notes: some 6 MB


class Place(NamedTuple):
    """Where a packet's bytes are; places sort by time, then by order of interfaces."""

    time_ns: int
    captured_ns: int  # by the capture; 0 of events: an instant's packets come behind its events
    interface: int
    file: int
    offset: int
    size: int  # bytes there
    length: int  # of the packet, before it was cut


def in_time_order(
    places: Iterable[Place], file: IO[bytes], at_once: int = SORTED_AT_ONCE
) -> Iterator[Place]:
    """Return places by time; all have been read when it returns.

    The file, which is empty, holds those that memory shall not, and is read as they are yielded.
    """
    notes = (NOTE.pack(*place) for place in places)
    begins = [0]
    while part := sorted(islice(notes, at_once)):
        file.write(b"".join(part))
        begins.append(begins[-1] + len(part))
    each = max(1, at_once // len(begins))  # of each part: together as many as before
    parts = [_read(file, begin, end, each) for begin, end in pairwise(begins)]
    return (Place(*NOTE.unpack(note)) for note in heapq.merge(*parts))


def _read(file: IO[bytes], begin: int, end: int, at_once: int) -> Iterator[bytes]:
    """Yield the notes of a sorted part, read a few at a time."""
    for first in range(begin, end, at_once):
        file.seek(first * NOTE.size)
        data = file.read(min(at_once, end - first) * NOTE.size)
        for offset in range(0, len(data), NOTE.size):
            yield data[offset : offset + NOTE.size]
