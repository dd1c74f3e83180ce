"""The order in which the dispatcher does what nodes ask for at one instant of stepped time.

The machine must not decide whose random numbers measure a pair.
"""

import asyncio
from itertools import count

from programs.network_timers import timers_of
from wire.network_time import DISPATCHER, NetworkTime, SteppedTime


class Turns:
    """Has requests of one instant done at its end, in the order of their nodes' names."""

    def __init__(self, time: NetworkTime) -> None:
        """Wait by this time; paced, what comes first is done first."""
        self._time = time
        self._waiting: list[tuple[str, int, asyncio.Future[None]]] = []
        self._numbers = count()
        self.is_ordered = isinstance(time, SteppedTime)

    async def turn(self, node: str) -> None:
        """Return when what this node asks for now may be done."""
        if not isinstance(self._time, SteppedTime):
            return
        loop = asyncio.get_running_loop()
        if not self._waiting:
            timers = timers_of(loop, self._time, DISPATCHER)
            timers.call_at(self._time.now_ns(), self._begin)
        begins: asyncio.Future[None] = loop.create_future()
        self._waiting.append((node, next(self._numbers), begins))
        await begins

    def _begin(self) -> None:
        for _node, _number, begins in sorted(self._waiting, key=lambda each: each[:2]):
            if not begins.done():  # else who has asked went away
                begins.set_result(None)
        self._waiting.clear()
