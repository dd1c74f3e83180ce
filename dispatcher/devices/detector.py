"""The memory of one single-photon detector: its latest click, and afterpulses to come.

A click is followed by a dead time, which light that comes meanwhile does not extend, and with some
probability by one afterpulse, an exponential time later; it is seen if it falls into the gate of
a pulse. Afterpulses are clicks: they make the detector dead, but have no afterpulses themselves.

The clicks that a detector with a dead time sees: unseen clicks do not extend it.

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

from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.photon_random import PhotonRandom
from wire.parameters.physics import Detectors

Mask = NDArray[np.bool_]
Positions = NDArray[np.int32]
Slots = NDArray[np.int64]  # of a train, counted from 0

MOST_STEPS = 64  # of a walk, however few clicks there are
MANY = 64  # slots for each click, or fewer, and all slots are gone through
MOST_DEAD = 8  # slots, of which there is a table
LEAST_TRAIN = 2048  # slots, from which on the table is quicker
PIECE = 32  # bytes
SETTLING = 8  # bytes, of a piece, that mostly decide what is dead behind it


def seen(slots: Slots, dead_slots: int, train: int) -> Slots:
    """Return which clicks come at least `dead_slots` slots after the last that is seen.

    Clicks are slots of a train, ascending.
    """
    if dead_slots <= 1 or not slots.size:
        return slots
    many = slots.size * MANY >= train
    if dead_slots <= MOST_DEAD and train >= LEAST_TRAIN and many:
        return slots.compress(_by_table(marked(slots, train), dead_slots)[slots])
    dead_slots = min(dead_slots, train)
    following = _following(slots, dead_slots, train, many)
    entries = np.append(0, np.flatnonzero(slots[1:] - slots[:-1] >= dead_slots) + 1)
    longest = np.diff(entries, append=slots.size).max()
    if longest > MOST_STEPS + 2 * np.sqrt(slots.size):
        entries = _entries(following)
    return slots[_walk(following, entries)]


def _following(slots: Slots, dead_slots: int, train: int, many: bool) -> Positions:
    """Return the first click that the detector can see after each."""
    if not many:
        return slots.searchsorted(slots + dead_slots).astype(np.int32)
    before = np.zeros(train + 1, dtype=np.int32)  # clicks before a slot
    np.cumsum(marked(slots, train), out=before[1:])
    return before[np.minimum(slots + dead_slots, train)]


def marked(slots: Slots, train: int) -> Mask:
    mask = np.zeros(train, dtype=bool)
    mask[slots] = True
    return mask


def distinct(slots: Slots) -> Slots:
    """Return each of some slots, which ascend, once."""
    new = np.ones(slots.size, dtype=bool)
    new[1:] = slots[1:] != slots[:-1]
    return slots.compress(new)


def union(one: Slots, other: Slots) -> Slots:
    """Return slots that are in one or the other; all ascend, and are distinct."""
    if one.size < other.size:
        one, other = other, one
    if not other.size:
        return one
    at = one.searchsorted(other)
    new = one[np.minimum(at, one.size - 1)] != other
    return np.insert(one, at[new], other[new])


def among(values: NDArray[np.int64], slots: Slots) -> Mask:
    """Return which values are among slots, which ascend."""
    if not slots.size:
        return np.zeros(values.size, dtype=bool)
    if slots.size * MANY >= slots[-1]:
        last = int(slots[-1])
        return np.asarray(marked(slots, last + 2)[np.minimum(values, last + 1)], np.bool_)
    nearest = slots[np.minimum(slots.searchsorted(values), slots.size - 1)]
    return np.equal(nearest, values)


class _Table(NamedTuple):
    """By 256 times the slots that are dead before a byte of clicks, and the byte."""

    seen: NDArray[np.uint8]
    behind: NDArray[np.intp]  # 256 times the slots that are dead behind it


@cache
def _table(dead_slots: int) -> _Table:
    dead, byte = np.divmod(np.arange(dead_slots * 256), 256)
    detected = np.zeros(byte.size, np.uint8)
    for bit in range(8):
        sees = (dead == 0) & (byte >> bit & 1 == 1)
        detected |= sees.astype(np.uint8) << np.uint8(bit)
        dead = np.where(sees, dead_slots - 1, np.maximum(dead - 1, 0))
    return _Table(detected, dead * 256)


def _by_table(clicks: Mask, dead_slots: int) -> Mask:
    """Return what is seen of a long train, after a dead time of few slots."""
    table = _table(dead_slots)
    packed = np.packbits(clicks, bitorder="little")
    pieces = -(-packed.size // PIECE)
    whole = np.zeros((pieces, PIECE), np.intp)
    whole.reshape(-1)[: packed.size] = packed
    rows = whole.T.copy()  # row r: byte r of each piece
    entered = np.zeros(pieces, np.intp)
    for last in (rows[-SETTLING:], rows):
        states = np.repeat(np.arange(dead_slots) * 256, pieces).reshape(dead_slots, pieces)
        for row in last:
            states = table.behind[states + row]
        if (states == states[0]).all():
            entered[1:] = states[0, :-1]
            break
    else:
        dead = 0
        for piece, behind in enumerate(states.T.tolist()):
            entered[piece] = dead
            dead = behind[dead // 256]
    visible = np.empty(rows.shape, np.uint8)
    for place, row in enumerate(rows):
        at = entered + row
        visible[place] = table.seen[at]
        entered = table.behind[at]
    bits = np.unpackbits(visible.T.reshape(-1), count=clicks.size, bitorder="little")
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


Moments = NDArray[np.float64]  # slots with their fractions
SAME_SLOT = 1e-9  # by which rounding may miss it


@dataclass(frozen=True)
class Train:
    """When photon k is looked for: start_ns + k * interval_ns; 0: with all the time they need."""

    start_ns: int
    interval_ns: float
    count: int

    def time_ns(self, slot: float) -> int:
        return self.start_ns + int(slot * self.interval_ns)


class Afterpulses(NamedTuple):
    """Those that there may be: the slots of the clicks that they follow, and their own."""

    causes: Slots
    moments: Moments


@dataclass(frozen=True)
class Clicks:
    seen: Slots
    afterpulses: int = 0
    dead: int = 0  # what would have clicked too


@dataclass
class Detector:
    device: Detectors
    _last_ns: int | None = None
    _to_come_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def watch(self, candidates: Slots, train: Train, random: PhotonRandom) -> Clicks:
        """Return which of the candidates, ascending, and afterpulses click in a train."""
        device = self.device
        if not train.interval_ns or not (device.dead_time_s or device.afterpulse_probability):
            return Clicks(candidates)
        left_over = self._left_over(train)
        pulses = self._afterpulses(train, random)
        after, seen = left_over, self._live(union(candidates, left_over), train)
        caused = among(pulses.causes, candidates)
        # Clicks decide which afterpulses there are, and these decide later clicks:
        # each round is right up to a later moment, and the last one throughout.
        while True:
            happened = caused & among(pulses.causes, seen)
            now = union(left_over, self._in_gates(pulses.moments[happened], train))
            if np.array_equal(now, after):
                break
            after, seen = now, self._live(union(candidates, now), train)
        self._remember(seen, pulses.moments[happened], train)
        lightless = among(seen, after) & ~among(seen, candidates)
        missed = union(candidates, after).size - seen.size
        return Clicks(seen, int(np.count_nonzero(lightless)), missed)

    def _live(self, candidates: Slots, train: Train) -> Slots:
        """Return the clicks that do not come within the dead time of others."""
        dead_ns = self.device.dead_time_s * 1e9
        if not dead_ns:
            return candidates
        dead_slots = int(np.ceil(dead_ns / train.interval_ns - SAME_SLOT))
        if self._last_ns is not None and self._last_ns < train.start_ns:
            since_ns = train.start_ns - self._last_ns
            first = int(np.ceil((dead_ns - since_ns) / train.interval_ns - SAME_SLOT))
            candidates = candidates[candidates.searchsorted(first) :]
        return seen(candidates, dead_slots, train.count)

    def _afterpulses(self, train: Train, random: PhotonRandom) -> Afterpulses:
        causes = random.events("afterpulse", self.device.afterpulse_probability)
        waits = random.generator("afterpulse delay").standard_exponential(causes.size)
        moments = causes + waits * (self.device.afterpulse_s * 1e9 / train.interval_ns)
        later = np.rint(moments) > causes
        return Afterpulses(causes[later], moments[later])

    def _left_over(self, train: Train) -> Slots:
        moments = (self._to_come_ns - train.start_ns).astype(np.float64) / train.interval_ns
        return self._in_gates(moments, train)

    def _in_gates(self, moments: Moments, train: Train) -> Slots:
        nearest = np.rint(moments)
        off_ns = np.abs(moments - nearest) * train.interval_ns
        inside = (nearest >= 0) & (nearest < train.count) & (off_ns <= self.device.gate_s * 5e8)
        return distinct(np.sort(nearest[inside].astype(np.int64)))

    def _remember(self, seen: Slots, afterpulses: Moments, train: Train) -> None:
        if seen.size:
            self._last_ns = max(self._last_ns or 0, train.time_ns(int(seen[-1])))
        to_come = afterpulses[afterpulses > train.count - 0.5] * train.interval_ns
        fresh = train.start_ns + to_come.astype(np.int64)
        later_ns = self._to_come_ns[self._to_come_ns >= train.time_ns(train.count)]
        self._to_come_ns = np.concatenate((later_ns, fresh))
