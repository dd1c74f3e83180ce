"""The event loop of a host: its clock, pauses and time-outs count the time of the network.

So every protocol of a host keeps to the time scale, and none needs to know of it. What finds and
watches the network, before and beside its sessions, goes by the wall: `wall_sleep`.
"""

import asyncio
import time
from collections.abc import Callable, Coroutine
from contextvars import Context
from typing import Any, TypeVarTuple, Unpack

import uvloop

from wire.network_time import NetworkTime

Ts = TypeVarTuple("Ts")


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


async def wall_sleep(seconds: float) -> None:
    """Pause for seconds of the wall clock."""
    await asyncio.sleep(_network_s(seconds))


def wall_timeout(seconds: float) -> asyncio.Timeout:
    """Return a time-out of seconds of the wall clock."""
    return asyncio.timeout(_network_s(seconds))


def _network_s(wall_s: float) -> float:
    loop = asyncio.get_running_loop()
    return loop.network_time.network_s(wall_s) if isinstance(loop, NetworkLoop) else wall_s


def run(main: Coroutine[Any, Any, None], network_time: NetworkTime) -> None:
    """Run a host's program to its end."""
    with asyncio.Runner(loop_factory=lambda: NetworkLoop(network_time)) as runner:
        runner.run(main)
