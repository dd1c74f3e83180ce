"""Polarisation compensators: when they look at their reference light, and what they undo.

The reference comes with the data, by the same fibres: light meets the inverse of the turn that they
made when its compensator looked last. A look counts when the retarders have moved; until then the
earlier setting holds, or, if the reference interrupts, light is lost. Looks come at equal intervals
from the first light on, and from each request on. Only those that light can tell are evaluated, and
of error rates those in its time. A compensator keeps a setting for each path, whose reference is
taken to be there before the path is. Behind a compensator another reference begins, so that the
next one undoes what follows alone.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.retarders import (
    Settings,
    angle,
    error_rate,
    inverse,
    settings_for,
    turn_by,
)
from dispatcher.fiber.noise import Loss, Schedule
from dispatcher.fiber.turn import STILL, Quaternions, Turn, of_vectors, product
from dispatcher.sabot.draws import Draws
from wire.config import FiberEnd
from wire.parameters.physics import ERROR_RATE, MULTIPLEXED, Compensator, Device
from wire.parameters.switch import INNER_PORTS

Times = NDArray[np.int64]
Path = tuple[FiberEnd, FiberEnd]  # where light began, and where it comes out

MOST_KEPT = 1000  # changes of a schedule, and settings of a path
SETTLED = 2  # looks before light, of which the earlier one holds until retarders have moved


class CompensatorLoss(Loss):
    """Of a compensator: in its retarders, and of pulses that are reference light."""


@dataclass
class Intervals:
    """When a compensator looks: from times on, each at equal intervals."""

    since_ns: list[int] = field(default_factory=list)
    every_ns: list[int] = field(default_factory=list)

    def begin(self, every_s: float, now_ns: int) -> None:
        self.since_ns.append(now_ns)
        self.every_ns.append(round(every_s * 1e9))
        del self.since_ns[:-MOST_KEPT], self.every_ns[:-MOST_KEPT]

    def between(self, first_ns: int, last_ns: int) -> Times:
        """Return the last two looks until a time, and those from then on to another."""
        looks = [np.zeros(0, np.int64)]
        ends_ns = [*self.since_ns[1:], last_ns + 1]
        for since_ns, every_ns, end_ns in zip(self.since_ns, self.every_ns, ends_ns, strict=True):
            number = max((min(first_ns, end_ns) - since_ns) // every_ns - SETTLED, 0)
            start_ns = since_ns + number * every_ns
            looks.append(np.arange(start_ns, min(end_ns, last_ns + 1), every_ns, dtype=np.int64))
        return _latest(np.concatenate(looks), first_ns)


class Setting(NamedTuple):
    retardances: Settings
    from_ns: int  # when they have moved
    turn: Quaternions


class Correction(NamedTuple):
    """The effect of a compensator on light of a path."""

    turn: Turn | None  # None: nothing
    dark: NDArray[np.bool_] | None  # photons that come while it looks, shape (k,)
    detail: str  # of the event log, if there is a new look


class Compensation:
    def __init__(self, devices: Mapping[str, Device], draws: Draws) -> None:
        parts = {node: device.compensator for node, device in devices.items()}
        self._parts = {node: part for node, part in parts.items() if part.retarders}
        self._draws = draws
        self._intervals = {node: Intervals() for node in self._parts}
        self._settings: defaultdict[Path, dict[int, Setting]] = defaultdict(dict)

    def of(self, node: str) -> Compensator | None:
        return self._parts.get(node)

    def at(self, end: FiberEnd) -> Compensator | None:
        """Return that of a port; light of parts of a switch comes in behind its compensators."""
        inner = end.port.isdecimal() and int(end.port) in INNER_PORTS
        return None if inner else self.of(end.node)

    def loss(self, end: FiberEnd) -> CompensatorLoss | None:
        part = self.at(end)
        return CompensatorLoss(part.loss_db) if part is not None and part.loss_db > 0 else None

    def disturbs(self, end: FiberEnd) -> bool:
        """Return whether the compensator of a port acts on light that has met no drift."""
        part = self.at(end)
        return part is not None and _disturbs(part)

    def light_begins(self, now_ns: int) -> None:
        for node, intervals in self._intervals.items():
            if not intervals.since_ns:
                intervals.begin(self._parts[node].every_s, now_ns)

    def look(self, node: str, now_ns: int, every_s: float | None = None) -> float:
        """Look now, and from then on at this interval (None: the device's), which is returned."""
        every_s = self._parts[node].every_s if every_s is None else every_s
        self._intervals[node].begin(every_s, now_ns)
        return every_s

    def look_now(self, node: str, now_ns: int) -> None:
        """Look now, and go on at the same interval."""
        every_ns = self._intervals[node].every_ns
        self.look(node, now_ns, every_ns[-1] / 1e9 if every_ns else None)

    def looks(self, first_ns: int, last_ns: int) -> dict[str, Times]:
        """Return the looks that light can tell which leaves in this time, by node."""
        return {node: each.between(first_ns, last_ns) for node, each in self._intervals.items()}

    def correct(
        self, path: Path, looks: Mapping[str, Times], turn: Turn | None, leaves: Schedule
    ) -> Correction:
        """Return what the compensator at the end of a path does to light that leaves so."""
        part, mine_ns = self._parts[path[1].node], looks[path[1].node]
        looked = np.tile(STILL.quaternions, (mine_ns.size, 1))
        if turn is not None and part.reference == ERROR_RATE:
            mine_ns = mine_ns[mine_ns >= leaves.first_ns]
            photons = np.array([_first(leaves, look_ns) for look_ns in mine_ns], np.int64)
            looked = turn.quaternions[turn.stretch(photons)]
        elif turn is not None and turn.looked is not None:
            looked = turn.looked[every_look(looks).searchsorted(mine_ns)]
        elif not _disturbs(part):
            return Correction(None, None, "")
        by_look, detail = self._settings[path], ""
        for look_ns, met in zip(mine_ns.tolist(), looked, strict=True):
            if look_ns not in by_look:
                by_look[look_ns] = self._set(path, look_ns, met)
                left = product(by_look[look_ns].turn, met)
                detail = (
                    f"looked {(leaves.last_ns - look_ns) / 1e9:.3g} s before the last photon left: "
                    f"turn of {angle(met):.3g} rad, {angle(left):.2g} rad left"
                )
        all_ns = np.array(sorted(by_look), np.int64)
        mine_ns = _latest(all_ns[all_ns <= leaves.last_ns], leaves.first_ns)
        settings = [by_look[look_ns] for look_ns in mine_ns.tolist()]
        for old_ns in all_ns[:-MOST_KEPT].tolist():
            del by_look[old_ns]
        dark = None
        if part.reference != MULTIPLEXED:
            dark = np.zeros(leaves.photons, bool)
            for look_ns, setting in zip(mine_ns.tolist(), settings, strict=True):
                begin, end = _first(leaves, look_ns), _first(leaves, setting.from_ns)
                dark[begin:end] = True
        return Correction(_in_turn(settings, leaves), dark, detail)

    def _set(self, path: Path, look_ns: int, met: Quaternions) -> Setting:
        part, settings = self._parts[path[1].node], self._settings[path]
        at_rest = Setting(np.zeros(part.retarders), look_ns, STILL.quaternions[0])
        held = settings[max(settings)] if settings else at_rest
        wrong = error_rate(product(held.turn, met))
        if part.reference == ERROR_RATE and wrong <= part.error_limit:
            return held
        seen = met
        if part.error_rad:
            drawn = self._draws.generator((0, 0, 0), f"look {look_ns} of {path}")
            error = drawn.standard_normal(3) * part.error_rad / sqrt(3)
            seen = product(of_vectors(error), met)
        retardances = settings_for(inverse(seen), held.retardances, part.range_rad)
        moving_s = float(np.abs(retardances - held.retardances).max()) / part.speed_rad_per_s
        from_ns = look_ns + round((part.measuring_s + moving_s) * 1e9)
        return Setting(retardances, from_ns, turn_by(retardances))


def _disturbs(part: Compensator) -> bool:
    return part.error_rad > 0 or part.reference != MULTIPLEXED


def _latest(looks_ns: Times, first_ns: int) -> Times:
    """Return the last two looks until a time, and those from then on."""
    before = int(looks_ns.searchsorted(first_ns, side="right"))
    return looks_ns[max(before - SETTLED, 0) :]


def every_look(looks: Mapping[str, Times]) -> Times:
    return np.unique(np.concatenate([np.zeros(0, np.int64), *looks.values()]))


def _first(leaves: Schedule, time_ns: int) -> int:
    """Return the first photon that leaves at a time or later."""
    waits = (time_ns - leaves.first_ns) / max(leaves.interval_ns, 1e-9)
    return int(np.clip(np.ceil(waits), 0, leaves.photons))


def _in_turn(settings: list[Setting], leaves: Schedule) -> Turn:
    """Return the settings that light meets one after the other."""
    starts, turns = [0], [STILL.quaternions[0]]
    for setting in settings:
        first = _first(leaves, setting.from_ns)
        if first < leaves.photons:
            while starts and starts[-1] >= first:
                starts.pop()
                turns.pop()
            starts.append(first)
            turns.append(setting.turn)
    return Turn(np.array(starts), np.array(turns))
