"""The event loop of a host: its clock, pauses and time-outs count the time of the network.

So every protocol of a host keeps to the time scale, and none needs to know of it. What finds and
watches the network, before and beside its sessions, goes by the wall: `wall_sleep`.
"""

import asyncio
import math
import time
from collections.abc import Callable, Coroutine
from contextvars import Context
from typing import Any, TypeVar, TypeVarTuple, Unpack

import uvloop

from wire.network_time import NetworkTime

T = TypeVar("T")
Ts = TypeVarTuple("Ts")
WALL = NetworkTime()  # without a scale: a second of the network is one of the wall


class NetworkLoop(uvloop.Loop):
    """An event loop whose seconds are those of the network."""

    def __init__(self, network_time: NetworkTime) -> None:
        """Begin to count the time of the network."""
        super().__init__()
        self.network_time = network_time

    def time(self) -> float:
        """Return the time of the network."""
        return self.network_time.network_s(time.monotonic())

    def call_later(
        self,
        delay: float,
        callback: Callable[[Unpack[Ts]], object],
        *arguments: *Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        """Call back after a time of the network; `call_at` and all time-outs come to here."""
        wall_s = self.network_time.wall_s(delay)
        return super().call_later(wall_s, callback, *arguments, context=context)


def now_s() -> float:
    """Return the time in seconds of the network, to measure by."""
    return asyncio.get_running_loop().time()


async def wall_sleep(seconds: float, most_s: float = math.inf) -> None:
    """Pause for seconds of the wall clock, but for no more than so many of the network."""
    await asyncio.sleep(min(_network_s(seconds), most_s))


def wall_timeout(seconds: float) -> asyncio.Timeout:
    """Return a time-out of seconds of the wall clock."""
    return asyncio.timeout(_network_s(seconds))


def _network_s(wall_s: float) -> float:
    loop = asyncio.get_running_loop()
    return loop.network_time.network_s(wall_s) if isinstance(loop, NetworkLoop) else wall_s


def run(main: Coroutine[Any, Any, T], network_time: NetworkTime = WALL) -> T:
    """Run a host's program to its end, and return what it does."""
    with asyncio.Runner(loop_factory=lambda: NetworkLoop(network_time)) as runner:
        return runner.run(main)
