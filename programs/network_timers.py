"""Timers of an event loop that count stepped time of the network."""

import asyncio
import heapq
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from contextvars import Context
from itertools import count
from typing import Any
from weakref import WeakKeyDictionary

from wire.network_time import NEVER, PROGRAMS, GateClient, NetworkTime, SteppedTime


class Timer(asyncio.TimerHandle):
    """A callback that is due at an instant, unless it is cancelled before."""

    def __init__(
        self,
        timers: "NetworkTimers",
        due_ns: int,
        callback: Callable[..., object],
        arguments: tuple[Any, ...],
        context: Context | None,
    ) -> None:
        when = (due_ns - timers.time.since_ns) / 1e9
        super().__init__(when, callback, arguments, timers.loop, context)
        self.due_ns = due_ns
        self._timers = timers

    def cancel(self) -> None:
        """Do not call back; the clock does not wait for this instant."""
        if not self.cancelled():
            asyncio.Handle.cancel(self)
            self._timers.changed()


class NetworkTimers:
    """The timers of one event loop, of which the gate knows the earliest.

    Where it is not this program's turn yet, those of this instant are due when the gate says so.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, time: SteppedTime, turn: int = PROGRAMS
    ) -> None:
        """Connect to the gate; raise OSError if there is none."""
        self.loop, self.time = loop, time
        self._gate = GateClient(time, turn)
        self._is_last = turn > PROGRAMS
        self._queues: tuple[list[tuple[int, int, Timer]], ...] = [], []  # the background's behind
        self._numbers = count()
        self._is_changing = False
        loop.add_reader(self._gate.fileno(), self._notified)

    def call_at(
        self,
        due_ns: int,
        callback: Callable[..., object],
        *arguments: Any,
        context: Context | None = None,
        in_background: bool = False,
    ) -> Timer:
        """Call back once the clock has reached an instant; it does not leap for the background."""
        timer = Timer(self, due_ns, callback, arguments, context)
        heapq.heappush(self._queues[in_background], (due_ns, next(self._numbers), timer))
        self.changed()
        return timer

    async def wait_until(self, time_ns: int) -> None:
        if self.time.now_ns() >= time_ns:
            return
        reached = self.loop.create_future()
        timer = self.call_at(time_ns, reached.set_result, None)
        try:
            await reached
        finally:
            timer.cancel()

    def changed(self) -> None:
        """Tell the gate the earliest instant before the loop waits."""
        if not self._is_changing:
            self._is_changing = True
            self.loop.call_soon(self._tell)

    def close(self) -> None:
        self.loop.remove_reader(self._gate.fileno())
        self._gate.close()

    def _notified(self) -> None:
        try:
            in_background = self._gate.take_notice()
        except EOFError:
            self.close()
            raise
        if self._is_last or in_background:
            self._run_due(self._queues[in_background])
        self.changed()

    def _tell(self) -> None:
        self._is_changing = False
        if not self._is_last:
            self._run_due(self._queues[0])
        if not self._is_changing:  # else once more, behind what these have done
            self._gate.wait_for(*map(self._next_ns, self._queues))

    def _run_due(self, queue: list[tuple[int, int, Timer]]) -> None:
        while self._next_ns(queue) <= self.time.now_ns():
            heapq.heappop(queue)[2]._run()

    def _next_ns(self, queue: list[tuple[int, int, Timer]]) -> int:
        """Return when the first is due; forget those before it that were cancelled."""
        while queue and queue[0][2].cancelled():
            heapq.heappop(queue)
        return queue[0][0] if queue else NEVER


_timers: WeakKeyDictionary[asyncio.AbstractEventLoop, NetworkTimers] = WeakKeyDictionary()


def timers_of(
    loop: asyncio.AbstractEventLoop, time: SteppedTime, turn: int = PROGRAMS
) -> NetworkTimers:
    """Return the timers of an event loop; the first time, connect to the gate."""
    if loop not in _timers:
        _timers[loop] = NetworkTimers(loop, time, turn)
    return _timers[loop]


def close_timers(loop: asyncio.AbstractEventLoop) -> None:
    if (timers := _timers.pop(loop, None)) is not None:
        timers.close()


def timeout(time: NetworkTime, seconds: float) -> AbstractAsyncContextManager[object]:
    """Return the time-out of a wait, in seconds of the network."""
    if isinstance(time, SteppedTime):
        return _stepped_timeout(timers_of(asyncio.get_running_loop(), time), seconds)
    return asyncio.timeout(time.wall_s(seconds))


@asynccontextmanager
async def _stepped_timeout(timers: NetworkTimers, seconds: float) -> AsyncIterator[object]:
    async with asyncio.timeout(None) as limit:
        due_ns = timers.time.now_ns() + round(seconds * 1e9)
        timer = timers.call_at(due_ns, lambda: limit.reschedule(timers.loop.time()))
        try:
            yield limit
        finally:
            timer.cancel()


async def background_sleep(time: NetworkTime, seconds: float) -> None:
    """Return after seconds of the wall; stepped, of the network, but the clock does not leap."""
    if not isinstance(time, SteppedTime):
        await asyncio.sleep(seconds)
        return
    loop, due_ns = asyncio.get_running_loop(), time.now_ns() + round(seconds * 1e9)
    passed = loop.create_future()
    timer = timers_of(loop, time).call_at(due_ns, passed.set_result, None, in_background=True)
    try:
        await passed
    finally:
        timer.cancel()


async def sleep_until(time: NetworkTime, time_ns: int) -> None:
    if isinstance(time, SteppedTime):
        await timers_of(asyncio.get_running_loop(), time).wait_until(time_ns)
    elif (remaining_ns := time_ns - time.now_ns()) > 0:
        await asyncio.sleep(time.wall_s(remaining_ns / 1e9))
