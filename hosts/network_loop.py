"""The event loop of a host: its clock, pauses and time-outs count the time of the network.

So every protocol of a host keeps to it, and none needs to know how it passes. Tasks that find
and watch the network, before and beside its sessions, wait in the background: by the wall, or
whenever stepped time has gone on.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from contextvars import Context
from typing import Any, TypeVar, TypeVarTuple, Unpack

import uvloop

from programs.network_timers import close_timers, timers_of
from wire.network_time import NetworkTime, SteppedTime

T = TypeVar("T")
Ts = TypeVarTuple("Ts")
CallLater = Callable[[float, Callable[[], object]], asyncio.TimerHandle]
WALL = NetworkTime()  # without a scale: a second of the network is one of the wall


class NetworkLoop(uvloop.Loop):
    """An event loop whose seconds are those of the network."""

    def __init__(self, network_time: NetworkTime) -> None:
        super().__init__()
        self.network_time = network_time

    def time(self) -> float:
        return self.network_time.now_s()

    def call_later(
        self,
        delay: float,
        callback: Callable[[Unpack[Ts]], object],
        *arguments: *Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Call back after a time of the network; `call_at` and all time-outs come to here."""
        time = self.network_time
        if isinstance(time, SteppedTime):
            # Less than a nanosecond is one: else who waits for a deadline whose sum was rounded up
            # is called again and again at an instant that never ends.
            due_ns = time.now_ns() + max(round(delay * 1e9), delay > 0)
            return timers_of(self, time).call_at(due_ns, callback, *arguments, context=context)
        return super().call_later(time.wall_s(delay), callback, *arguments, context=context)

    def close(self) -> None:
        close_timers(self)
        super().close()

    def background_call_later(
        self, delay: float, callback: Callable[[], object]
    ) -> asyncio.TimerHandle:
        """Call back after seconds of the wall; stepped, of the network, but it does not leap."""
        time = self.network_time
        if not isinstance(time, SteppedTime):
            return self.wall_call_later(delay, callback)
        due_ns = time.now_ns() + round(delay * 1e9)
        return timers_of(self, time).call_at(due_ns, callback, in_background=True)

    def wall_call_later(self, delay: float, callback: Callable[[], object]) -> asyncio.TimerHandle:
        """Call back after seconds of the wall, for which stepped time does not wait."""
        return super().call_later(delay, callback)


def now_s() -> float:
    """Return the time in seconds of the network, to measure by."""
    return asyncio.get_running_loop().time()


async def retry_pause(seconds: float, most_s: float) -> None:
    """Pause before a retry: seconds of the wall if that paces time, and at most `most_s` of it."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, NetworkLoop):
        seconds = loop.network_time.network_s(seconds)
    await asyncio.sleep(min(seconds, most_s))


async def wall_sleep(seconds: float) -> None:
    await _sleep(_wall_call_later, seconds)


async def background_sleep(seconds: float) -> None:
    await _sleep(_background_call_later, seconds)


async def _sleep(call_later: CallLater, seconds: float) -> None:
    passed = asyncio.Event()
    timer = call_later(seconds, passed.set)
    try:
        await passed.wait()
    finally:
        timer.cancel()


def wall_timeout(seconds: float) -> AbstractAsyncContextManager[None]:
    """Limit a wait to seconds of the wall clock; raise TimeoutError then."""
    return _timeout(_wall_call_later, seconds)


def background_timeout(seconds: float) -> AbstractAsyncContextManager[None]:
    """Limit a wait in the background; raise TimeoutError then."""
    return _timeout(_background_call_later, seconds)


@asynccontextmanager
async def _timeout(call_later: CallLater, seconds: float) -> AsyncIterator[None]:
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(None) as limit:
        timer = call_later(seconds, lambda: limit.reschedule(loop.time()))
        try:
            yield
        finally:
            timer.cancel()


def _wall_call_later(seconds: float, callback: Callable[[], object]) -> asyncio.TimerHandle:
    loop = asyncio.get_running_loop()
    call_later = loop.wall_call_later if isinstance(loop, NetworkLoop) else loop.call_later
    return call_later(seconds, callback)


def _background_call_later(seconds: float, callback: Callable[[], object]) -> asyncio.TimerHandle:
    loop = asyncio.get_running_loop()
    if isinstance(loop, NetworkLoop):
        return loop.background_call_later(seconds, callback)
    return loop.call_later(seconds, callback)


def housekeeping_later(seconds: float, callback: Callable[[], object]) -> asyncio.TimerHandle:
    """Call back after seconds of the network, for which stepped time makes no leap."""
    loop = asyncio.get_running_loop()
    if isinstance(loop, NetworkLoop) and isinstance(loop.network_time, SteppedTime):
        return loop.background_call_later(seconds, callback)
    return loop.call_later(seconds, callback)


def run(main: Coroutine[Any, Any, T], network_time: NetworkTime = WALL) -> T:
    """Run a host's program to its end, and return what it does."""
    with asyncio.Runner(loop_factory=lambda: NetworkLoop(network_time)) as runner:
        return runner.run(main)
