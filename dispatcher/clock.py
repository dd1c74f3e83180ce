"""Time in nanoseconds since 1970, as packet captures stamp it, but never jumping."""

import asyncio
import time
from typing import Protocol

# The event loop sleeps in steps of a millisecond; a shorter wait than this yields instead.
SHORT_WAIT_NS = 200_000


class Clock(Protocol):
    """What the dispatcher needs of a clock."""

    def now_ns(self) -> int:
        """Return the time."""

    async def wait_until(self, time_ns: int) -> None:
        """Return once the time has passed."""


class CaptureClock:
    """The monotonic clock, set once by the clock that stamps captures."""

    def __init__(self) -> None:
        """Read both clocks."""
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the time."""
        return time.monotonic_ns() + self._offset_ns

    async def wait_until(self, time_ns: int) -> None:
        """Return once the time has passed."""
        while (remaining_ns := time_ns - self.now_ns()) >= 0:
            await asyncio.sleep(remaining_ns / 1e9 if remaining_ns > SHORT_WAIT_NS else 0)
