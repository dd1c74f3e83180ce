"""A repeater: a link to either side, and Bell measurements between them."""

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

import numpy as np

from hosts.hardware.qnic import Qnic
from hosts.middleware.services.swapping.bits import Bits, Swapped
from hosts.middleware.services.swapping.link import IncomingLink, OutgoingLink
from hosts.middleware.session.blocks import take
from hosts.middleware.session.errors import SessionError
from wire.device import SwapOrder
from wire.metadata import Reason

A = TypeVar("A")
B = TypeVar("B")


class Repeater:
    """Joins the links to its left and to its right."""

    def __init__(
        self,
        qnic: Qnic,
        links: tuple[IncomingLink, OutgoingLink],
        order: SwapOrder,
        distinguishable_states: frozenset[int],
    ) -> None:
        """Join two open links as ordered; these Bell states are told apart here."""
        self._qnic, self._order, self._distinguishable_states = qnic, order, distinguishable_states
        self._left, self._right = links

    async def run(self) -> None:
        """Swap block after block until the opener ends it; raise SessionError if it fails."""
        while (coming := await self._left.announced()) is not None:
            await self._swap(*coming)
        await self._right.finish()
        self._left.agree()

    async def _swap(self, number: int, size: int) -> None:
        pairs = await together(self._left.take(number, size), self._right.make(number, size))
        turn = Turn(self._order)
        await together(self._pass_on(number, turn), self._join(number, pairs, turn))

    async def _pass_on(self, number: int, turn: "Turn") -> None:
        """Pass on all that others tell of their swaps."""
        await together(self._pass_right(number, turn), self._pass_left(number, turn))
        turn.require()

    async def _pass_right(self, number: int, turn: "Turn") -> None:
        """Pass the bits of all swaps to the left on, as they come."""
        async for swapped in self._left.swapped(number, self._order.place):
            self._right.say(number, swapped)
            turn.heard(swapped.place)

    async def _pass_left(self, number: int, turn: "Turn") -> None:
        """Pass notices of swaps to the right on, as they come; one may be for this place."""
        for _ in range(self._order.notices):
            place, waiting = await self._right.notice(number)
            if not 0 < waiting <= self._order.place < place:
                text = f"notice of a swap at place {place} for place {waiting}"
                raise SessionError(Reason.PROTOCOL, f"{text}, at place {self._order.place}")
            if waiting == self._order.place:
                turn.heard(place)
            else:
                self._left.notify(number, place, waiting)

    async def _join(self, number: int, pairs: tuple[int, int], turn: "Turn") -> None:
        """Swap when it is this repeater's turn, and tell those who have to know."""
        order = self._order
        await turn.has_come()
        self._right.say(number, await self._measure(number, *pairs))
        if order.tell_left:
            self._left.notify(number, order.place, order.tell_left)

    async def _measure(self, number: int, left: int, right: int) -> Swapped:
        """Join the first pairs of both sides, and let go of the rest of either."""
        size, place = min(left, right), self._order.place
        names = self._left.block(number), self._right.block(number)
        for name, there in zip(names, (left, right), strict=True):
            if size < there:
                await take(self._qnic, name, {name: np.arange(size)})
        if not size:
            return Swapped(
                place,
                0,
                Bits.of_outcomes(np.zeros(0, dtype=np.uint8), self._distinguishable_states),
            )
        found = await self._qnic.coincidences(*names)
        waited_ns = found.time_ns - (self._left.since_ns + self._right.since_ns) // 2
        bits = Bits.of_outcomes(found.outcomes, self._distinguishable_states)
        return Swapped(place, max(waited_ns // 1000, 0), bits)


class Turn:
    """When a repeater swaps a block: after those that it has been ordered to wait for."""

    def __init__(self, order: SwapOrder) -> None:
        """Wait for all of them."""
        self._missing = {order.after_left, order.after_right} - {0}
        self._come = asyncio.Event()
        self.heard(0)  # of nobody: there may be none to wait for

    def heard(self, place: int) -> None:
        """Note that the repeater at this place has swapped."""
        self._missing.discard(place)
        if not self._missing:
            self._come.set()

    def require(self) -> None:
        """Raise SessionError if somebody has not swapped, now that all have told."""
        if self._missing:
            text = f"nothing was heard of swaps at {sorted(self._missing)}, which come first"
            raise SessionError(Reason.PROTOCOL, text)

    async def has_come(self) -> None:
        """Return when all have swapped; whoever hears of them has a deadline."""
        await self._come.wait()


async def together(one: Coroutine[Any, Any, A], other: Coroutine[Any, Any, B]) -> tuple[A, B]:
    """Return the results of both; as soon as one fails, cancel the other and raise its error."""
    tasks = asyncio.create_task(one), asyncio.create_task(other)
    try:
        return await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
