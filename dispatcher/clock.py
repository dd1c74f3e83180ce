"""The clock of the network in nanoseconds, which never jumps.

It begins with the time since 1970, as packet captures stamp it, and goes on as slowly as the time
scale says.
"""

import asyncio
import time
from typing import Protocol

from programs.network_timers import sleep_until
from wire.network_time import REAL_TIME, NetworkTime, SteppedTime

READINGS = 8  # of both clocks at the start, of which the fastest counts
# The event loop sleeps in steps of a millisecond; a shorter wait here than this yields instead.
SHORT_WAIT_NS = 200_000


class Clock(Protocol):
    def now_ns(self) -> int:
        """Return the time."""

    async def wait_until(self, time_ns: int) -> None:
        """Return once the time has passed."""


class NetworkClock:
    """Time of the network, from the monotonic clock, set once by the clock that stamps captures."""

    def __init__(self, network_time: NetworkTime = REAL_TIME) -> None:
        self._time = network_time
        self._offset_ns = min(_reading() for _ in range(READINGS))[1]

    def now_ns(self) -> int:
        return self._time.network_ns(time.monotonic_ns() + self._offset_ns)

    async def wait_until(self, time_ns: int) -> None:
        while (remaining_ns := time_ns - self.now_ns()) >= 0:
            wall_ns = self._time.wall_s(remaining_ns)
            await asyncio.sleep(wall_ns / 1e9 if wall_ns > SHORT_WAIT_NS else 0)


class SteppedClock:
    """Stepped time of the network, which stands while a program runs."""

    def __init__(self, time: SteppedTime) -> None:
        self._time = time
        self.now_ns = time.now_ns

    async def wait_until(self, time_ns: int) -> None:
        await sleep_until(self._time, time_ns + 1)


def clock_of(time: NetworkTime) -> Clock:
    return SteppedClock(time) if isinstance(time, SteppedTime) else NetworkClock(time)


def _reading() -> tuple[int, int]:
    """Return within how many ns both clocks were read, and how far the monotonic one is behind.

    Others may have the processor in between, for milliseconds.
    """
    before_ns = time.monotonic_ns()
    stamped_ns = time.time_ns()
    after_ns = time.monotonic_ns()
    return after_ns - before_ns, stamped_ns - (before_ns + after_ns) // 2
