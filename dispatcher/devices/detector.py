"""The memory of one single-photon detector: its latest click, and afterpulses to come.

A click is followed by a dead time, which light that comes meanwhile does not extend, and with some
probability by one afterpulse, an exponential time later; it is seen if it falls into the gate of
a pulse. Afterpulses are clicks: they make the detector dead, but have no afterpulses themselves.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices import dead_time
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.registers import Mask
from wire.parameters.physics import Detectors

Slots = NDArray[np.float64]  # counted from 0, with their fractions
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

    causes: NDArray[np.intp]
    slots: Slots


@dataclass(frozen=True)
class Clicks:
    """The clicks of one detector in a train."""

    seen: Mask
    afterpulses: int = 0
    dead: int = 0  # what would have clicked too


@dataclass
class Detector:
    """One detector over time."""

    like: Detectors
    _last_ns: int | None = None
    _to_come_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def watch(self, candidates: Mask, train: Train, random: PhotonRandom) -> Clicks:
        """Return which of the candidates, shape (k,), and afterpulses click in a train."""
        like = self.like
        if not train.interval_ns or not (like.dead_time_s or like.afterpulse_probability):
            return Clicks(candidates)
        left_over = self._left_over(train)
        pulses = self._afterpulses(train, random)
        after, seen = left_over, self._live(candidates | left_over, train)
        # What clicks decides which afterpulses there are, and these decide what clicks later:
        # each round is right up to a later moment, and the last one throughout.
        while True:
            happened = seen[pulses.causes] & candidates[pulses.causes]
            now = left_over | self._in_gates(pulses.slots[happened], train)
            if np.array_equal(now, after):
                break
            after, seen = now, self._live(candidates | now, train)
        self._remember(seen, pulses.slots[happened], train)
        asked, clicks = (int(np.count_nonzero(mask)) for mask in (candidates | after, seen))
        return Clicks(seen, int(np.count_nonzero(seen & after & ~candidates)), asked - clicks)

    def _live(self, asked: Mask, train: Train) -> Mask:
        """Return the clicks that do not come within the dead time of others."""
        dead_ns = self.like.dead_time_s * 1e9
        if not dead_ns:
            return asked
        dead_slots = int(np.ceil(dead_ns / train.interval_ns - SAME_SLOT))
        if self._last_ns is not None and self._last_ns < train.start_ns:
            since_ns = train.start_ns - self._last_ns
            first = int(np.ceil((dead_ns - since_ns) / train.interval_ns - SAME_SLOT))
            if first > 0:
                asked = asked.copy()
                asked[:first] = False
        return dead_time.seen(asked, dead_slots)

    def _afterpulses(self, train: Train, random: PhotonRandom) -> Afterpulses:
        causes = random.events("afterpulse", self.like.afterpulse_probability)
        waits = random.generator("afterpulse delay").standard_exponential(causes.size)
        slots = causes + waits * (self.like.afterpulse_s * 1e9 / train.interval_ns)
        later = np.rint(slots) > causes
        return Afterpulses(causes[later], slots[later])

    def _left_over(self, train: Train) -> Mask:
        slots = (self._to_come_ns - train.start_ns).astype(np.float64) / train.interval_ns
        return self._in_gates(slots, train)

    def _in_gates(self, slots: Slots, train: Train) -> Mask:
        nearest = np.rint(slots)
        off_ns = np.abs(slots - nearest) * train.interval_ns
        inside = (nearest >= 0) & (nearest < train.count) & (off_ns <= self.like.gate_s * 5e8)
        found = np.zeros(train.count, dtype=bool)
        found[nearest[inside].astype(np.intp)] = True
        return found

    def _remember(self, seen: Mask, afterpulses: Slots, train: Train) -> None:
        before_end = int(seen[::-1].argmax())
        if seen[train.count - 1 - before_end]:
            self._last_ns = max(self._last_ns or 0, train.time_ns(train.count - 1 - before_end))
        to_come = afterpulses[afterpulses > train.count - 0.5] * train.interval_ns
        fresh = train.start_ns + to_come.astype(np.int64)
        kept = self._to_come_ns[self._to_come_ns >= train.time_ns(train.count)]
        self._to_come_ns = np.concatenate((kept, fresh))
