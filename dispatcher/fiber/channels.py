"""The channels of a fibre: light of one comes out, a little, in those beside it.

A demultiplexer lets of the light of channel c the share 10^(-channel_crosstalk_db / 10) out of each
of the ports c - 1 and c + 1. Nothing here depends on the state of stray light: in the other
channel it is a noise photon, if it comes within the window of a pulse there.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import CROSSTALK, approximation
from dispatcher.fiber.noise import Effect, Passage, Schedule
from dispatcher.switch.timeline import REMEMBERED_NS
from wire.parameters.fiber import Fiber

MOST_EXTRAS = 255
NS_PER_S = 1e9


class Passing(NamedTuple):
    """Light of a block where it leaves a fibre, and with which share of its photons."""

    schedule: Schedule
    share: float


@dataclass
class Traffic:
    """The light of one channel in one direction, of the last minute."""

    passing: deque[Passing] = field(default_factory=deque)

    def add(self, schedule: Schedule, share: float) -> None:
        while self.passing and (
            self.passing[0].schedule.last_ns < schedule.first_ns - REMEMBERED_NS
        ):
            self.passing.popleft()
        self.passing.append(Passing(schedule, share))

    def photons(
        self,
        times_ns: NDArray[np.int64],
        window_ns: float,
        rests_ps: NDArray[np.float64] | float = 0.0,
    ) -> NDArray[np.float64]:
        """Return how many of its photons leave within a window about each time, on average.

        Times are those of `times_ns`, and `rests_ps` later.
        """
        mean = np.zeros(times_ns.size)
        for schedule, share in self.passing:
            if schedule.first_ns - window_ns > times_ns[-1]:
                continue
            if schedule.last_ns + window_ns < times_ns[0]:
                continue
            later_ns = np.asarray(rests_ps - schedule.rest_ps, np.float64) / 1e3
            since_ns = times_ns - schedule.first_ns + later_ns
            mean += share * _within(schedule, since_ns, window_ns)
        return mean


def _within(
    schedule: Schedule, since_ns: NDArray[np.float64], window_ns: float
) -> NDArray[np.float64]:
    interval_ns = max(schedule.interval_ns, 1e-3)
    first = np.ceil((since_ns - window_ns / 2) / interval_ns)
    behind = np.ceil((since_ns + window_ns / 2) / interval_ns)  # the first that is not within
    inside: NDArray[np.float64] = np.clip(behind, 0, schedule.photons)
    inside -= np.clip(first, 0, schedule.photons)
    return inside


class ChannelCrosstalk:
    """Strays from the neighbouring channels of a fibre, and what strays into these from here.

    An approximation where it acts: that a photon is here is not kept together with its being lost
    there, and light of neighbours is counted by the way that it had when it was sent.
    """

    def __init__(self, fiber: Fiber, strand: Mapping[int, Traffic]) -> None:
        """Stray in this channel of a fibre; `strand` has the light of all, by channel."""
        assert fiber.channel_crosstalk_db is not None
        self._strand, self._channel = strand, fiber.channel
        self._neighbours = [
            each for each in (fiber.channel - 1, fiber.channel + 1) if 1 <= each <= fiber.channels
        ]
        self._share = 10 ** (-fiber.channel_crosstalk_db / 10)
        self._window_ns = fiber.pulse_window_s * NS_PER_S

    def _lit(self, channel: int) -> bool:
        return channel in self._strand and bool(self._strand[channel].passing)

    def effect(self, passage: Passage) -> Effect:
        stays = 1 - self._share * len(self._neighbours)
        lost = ~passage.happens("stay", stays)
        lit = [self._strand[neighbour] for neighbour in self._neighbours if self._lit(neighbour)]
        if not lit:
            return Effect(lost=lost, transmission=stays)
        schedule, window_ns = passage.schedule, self._window_ns
        rests_ps = schedule.pattern.rests_ps + schedule.rest_ps
        stray = [traffic.photons(schedule.times_ns, window_ns, rests_ps) for traffic in lit]
        means = np.sum(stray, axis=0) * self._share
        if not (most := float(np.max(means, initial=0.0))):
            return Effect(lost=lost, transmission=stays)
        drawn = passage.generator("strays").poisson(means)
        extras = np.minimum(drawn, MOST_EXTRAS).astype(np.uint8)
        named = approximation(CROSSTALK, -math.expm1(-most))  # of a pulse with another's photon
        return Effect(lost=lost, transmission=stays, extras=extras, exact=False, named=named)
