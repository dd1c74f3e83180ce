"""The clicks that a detector with a dead time sees: unseen clicks do not extend it.

    candidates   x x x . x . . x x
    dead 3       x d d . x . . x d      (x: seen, d: while dead)

The clicks that are seen make a chain, each link of which follows from the one before. To walk it
without a step in Python for each click, it is walked from many entries at once. A click after
a pause of a dead time is one, whatever came before. Where there are few such pauses the clicks are
cut into about sqrt(n) pieces, and where a walk leaves a piece is found for all its places at once.

Of a dead time of a few slots a table knows, for each byte of clicks and each number of slots that
are still dead before it, what is seen and how many are dead behind it. Pieces of a train are walked
at once, byte by byte: for all that may be dead at their begin first, then for what is.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Positions = NDArray[np.int32]

MOST_STEPS = 64  # of a walk, however few clicks there are
MOST_DEAD = 8  # slots, of which there is a table
LEAST_TRAIN = 2048  # slots, from which on the table is quicker
PIECE = 32  # bytes


def seen(clicks: Mask, dead_slots: int) -> Mask:
    """Return which clicks come at least `dead_slots` slots after the last that is seen."""
    if dead_slots <= 1:
        return clicks
    if dead_slots <= MOST_DEAD and clicks.size >= LEAST_TRAIN:
        return _by_table(clicks, dead_slots)
    slots = np.flatnonzero(clicks).astype(np.int32)
    if not slots.size:
        return clicks
    dead_slots = min(dead_slots, clicks.size)
    # The first click that the detector can see after each: clicks before a slot, counted.
    before = np.zeros(clicks.size + 1, dtype=np.int32)
    np.cumsum(clicks, out=before[1:])
    following = before[np.minimum(slots + np.int32(dead_slots), clicks.size)]
    entries = np.append(0, np.flatnonzero(slots[1:] - slots[:-1] >= dead_slots) + 1)
    longest = np.diff(entries, append=slots.size).max()
    if longest > MOST_STEPS + 2 * np.sqrt(slots.size):
        entries = _entries(following)
    found = np.zeros(clicks.size, dtype=bool)
    found[slots[_walk(following, entries)]] = True
    return found


class _Table(NamedTuple):
    """By 256 times the slots that are dead before a byte of clicks, and the byte."""

    seen: NDArray[np.uint8]
    behind: NDArray[np.intp]  # 256 times the slots that are dead behind it


@cache
def _table(dead_slots: int) -> _Table:
    dead, byte = np.divmod(np.arange(dead_slots * 256), 256)
    found = np.zeros(byte.size, np.uint8)
    for bit in range(8):
        sees = (dead == 0) & (byte >> bit & 1 == 1)
        found |= sees.astype(np.uint8) << np.uint8(bit)
        dead = np.where(sees, dead_slots - 1, np.maximum(dead - 1, 0))
    return _Table(found, dead * 256)


def _by_table(clicks: Mask, dead_slots: int) -> Mask:
    """Return what is seen of a long train, after a dead time of few slots."""
    table = _table(dead_slots)
    packed = np.packbits(clicks, bitorder="little")
    pieces = -(-packed.size // PIECE)
    whole = np.zeros((pieces, PIECE), np.intp)
    whole.reshape(-1)[: packed.size] = packed
    rows = whole.T.copy()  # row r: byte r of each piece
    states = np.repeat(np.arange(dead_slots) * 256, pieces).reshape(dead_slots, pieces)
    for row in rows:
        states = table.behind[states + row]
    entered, dead = np.zeros(pieces, np.intp), 0
    for piece, behind in enumerate(states.T.tolist()):
        entered[piece] = dead
        dead = behind[dead // 256]
    found = np.empty(rows.shape, np.uint8)
    for place, row in enumerate(rows):
        at = entered + row
        found[place] = table.seen[at]
        entered = table.behind[at]
    bits = np.unpackbits(found.T.reshape(-1), count=clicks.size, bitorder="little")
    return bits.view(np.bool_)


def _walk(following: Positions, entries: NDArray[np.signedinteger]) -> Mask:
    """Return what is visited from all entries; each walk ends at an entry, or at n."""
    stops = np.zeros(following.size + 1, dtype=bool)
    stops[entries] = stops[-1] = True
    visited = stops[:-1].copy()
    positions = entries
    while positions.size:
        positions = following[positions]
        positions = positions[~stops[positions]]
        visited[positions] = True
    return visited


def _entries(following: Positions) -> NDArray[np.intp]:
    """Cut 0..n-1 into pieces; return where the walk 0, following[0], ... enters each of them."""
    count = following.size
    width = int(np.sqrt(count)) + 1
    pieces = -(-count // width)
    exits = np.full((pieces, width), count, dtype=np.int32)
    exits.reshape(-1)[:count] = following
    exits = exits.T.copy()  # row r, column p: place r of piece p
    # A step within its piece is looked up further down, one out of it in its own place.
    below = exits - np.arange(pieces, dtype=np.int32) * width
    outside = (below >= width) | (exits == count)
    np.copyto(below, np.arange(width, dtype=np.int32)[:, None], where=outside)
    below *= pieces
    below += np.arange(pieces, dtype=np.int32)
    flat = exits.reshape(-1)
    for row in range(width - 1, -1, -1):
        exits[row] = flat[below[row]]
    entered, position = [], 0
    while position < count:
        entered.append(position)
        piece, row = divmod(position, width)
        position = int(exits[row, piece])
    return np.array(entered)
