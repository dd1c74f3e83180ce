"""A handshake for every Bell state (paper, figure "handshaking"), the next ones made ahead or not.

    pair 1   |-- handshake --|-- light --| close
    pair 2        |-- handshake --|-- light --| close
    pair 3             |-- handshake --|-- light --| close

Connections are closed in order: the newest one keeps the light path up. In the sequential handshake
nothing is made ahead, as in the paper, and each pair has a light path of its own:

    pair 1   |-- handshake --|-- light --| close
    pair 2                                      |-- handshake --|-- light --| close
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hosts.hardware.qnic import NoLight, Symbols
from hosts.middleware.services.superdense.sender import Singles
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.encoding import to_paulis

HANDSHAKES_AHEAD = 3
LIGHTS_AT_A_TIME = 2


@dataclass(frozen=True)
class Agreed:
    """A light path that is up, and by which operators symbols are sent over it."""

    channel: MetadataChannel
    encoding: int


ShakeHands = Callable[[int], Awaitable[Agreed]]
Light = Callable[[int, Symbols], Awaitable[int]]


class OneByOne:
    """Sends photons each under a handshake of its own."""

    def __init__(self, shake_hands: ShakeHands, light: Light, sequential: bool = False) -> None:
        """Sequential: a handshake begins when the pair before it is over."""
        self._shake_hands = shake_hands
        self._light = light
        self._sequential = sequential
        self._ahead = 1 if sequential else HANDSHAKES_AHEAD
        self._at_a_time = 1 if sequential else LIGHTS_AT_A_TIME
        self._handshakes: deque[asyncio.Task[Agreed]] = deque()
        self._lights: deque[asyncio.Task[int]] = deque()

    async def send(self, order: Singles) -> int:
        """Send pairs; one without light is just lost. Return when the first was sent (ns)."""
        first, symbols, count = order.first, order.symbols, order.symbols.size
        sent_ns = []
        try:
            for index in range(count):
                ahead = min(index + self._ahead, count)
                self._begin_handshakes(range(first + index, first + ahead))
                before = self._lights[-1] if self._lights else None
                agreed = await self._handshakes.popleft()
                pair = self._pair(first + index, agreed, symbols[index : index + 1], before)
                self._lights.append(asyncio.create_task(pair))
                if len(self._lights) == self._at_a_time:
                    sent_ns.append(await self._lights.popleft())
            sent_ns += await asyncio.gather(*self._lights)
        finally:
            await self._abandon()
        return int(np.max(sent_ns[:1], initial=0))

    def _begin_handshakes(self, numbers: range) -> None:
        for number in numbers[len(self._handshakes) :]:
            self._handshakes.append(asyncio.ensure_future(self._shake_hands(number)))

    async def _pair(
        self,
        number: int,
        agreed: Agreed,
        symbol: Symbols,
        before: asyncio.Task[int] | None,
    ) -> int:
        try:
            sent_ns = await self._light(number, to_paulis(symbol, agreed.encoding))
        except NoLight:
            sent_ns = 0
        finally:
            if before is not None:
                await asyncio.wait([before])
            if not self._sequential:
                agreed.channel.close()
        if self._sequential:
            await agreed.channel.end()
        return sent_ns

    async def _abandon(self) -> None:
        """End what was begun and is not needed any more."""
        await cancelled(self._lights)
        for outcome in await cancelled(self._handshakes):
            if isinstance(outcome, Agreed):
                outcome.channel.close()
        self._lights.clear()
        self._handshakes.clear()


async def cancelled(tasks: Iterable[asyncio.Task[Any]]) -> list[Any]:
    """Cancel tasks and return what became of each."""
    for task in tasks:
        task.cancel()
    return await asyncio.gather(*tasks, return_exceptions=True)
