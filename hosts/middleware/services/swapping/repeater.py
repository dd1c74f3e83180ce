"""A repeater at work: it waits for both its sides at a time; protocol.py says what it does.

Blocks follow each other before the first of them is done: each is a task, and hears by its number.
"""

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from hosts.middleware.services.swapping.link import (
    IncomingLink,
    Kept,
    OutgoingLink,
    to_the_left_of,
)
from hosts.middleware.services.swapping.protocol import Turn, UnderWay, joined
from hosts.middleware.session.ends import ConnectionEnd
from wire.device import SwapOrder

A = TypeVar("A")
B = TypeVar("B")


class Repeater:
    """Joins the links to its left and to its right."""

    def __init__(
        self,
        connections: tuple[ConnectionEnd, ConnectionEnd],
        links: tuple[IncomingLink, OutgoingLink],
        order: SwapOrder,
        distinguishable_states: frozenset[int],
    ) -> None:
        """Join two open links as ordered; these Bell states are told apart here."""
        self._order, self._distinguishable_states = order, distinguishable_states
        self._left, self._right = connections
        self._incoming, self._outgoing = links
        self._under_way = UnderWay(order.blocks)

    async def run(self) -> None:
        """Swap blocks, several beside each other, until the opener ends it.

        Raise SessionError if it fails: the first failure ends all.
        """
        try:
            async with asyncio.TaskGroup() as blocks:
                coming = self._incoming.announced
                while (block := await self._left.perform(coming())) is not None:
                    self._under_way.begin(block[0])
                    blocks.create_task(self._swap(*block))
        except BaseExceptionGroup as failures:
            raise failures.exceptions[0] from failures
        await self._right.perform(self._outgoing.finish())
        await self._left.carry_out(self._incoming.agree())

    async def _swap(self, number: int, size: int) -> None:
        kept = await together(
            self._left.perform(self._incoming.take(number, size)),
            self._right.perform(self._outgoing.make(number, size)),
        )
        if self._order.rounds:
            await self._purify_and_join(number, kept)
            return
        turn, has_come = Turn(self._order), asyncio.Event()
        if turn.has_come:  # there may be none to wait for
            has_come.set()
        await together(self._pass_on(number, turn, has_come), self._join(number, kept, has_come))

    async def _purify_and_join(self, number: int, kept: tuple[Kept, Kept]) -> None:
        """Swap what is left when all that ends here is purified; then pass on what others tell."""
        order = self._order
        left = self._incoming.purify(number, kept[0].size, order, order.seed(number))
        right = self._outgoing.purify(number, kept[1].size, order)
        sizes = await together(self._left.perform(left), self._right.perform(right))
        purified = kept[0]._replace(size=sizes[0]), kept[1]._replace(size=sizes[1])
        await self._tell_of_swap(number, purified)
        await together(self._relay_right(number), self._relay_left(number))

    async def _relay_right(self, number: int) -> None:
        for _ in range(self._order.to_right):
            parts = await self._left.perform(self._incoming.passing(number))
            await self._right.carry_out(self._outgoing.tell(number, parts))

    async def _relay_left(self, number: int) -> None:
        for _ in range(self._order.to_left):
            parts = await self._right.perform(self._outgoing.passing(number))
            await self._left.carry_out(self._incoming.tell(number, parts))

    async def _tell_of_swap(self, number: int, kept: tuple[Kept, Kept]) -> None:
        """Swap, and tell those to the right."""
        names = self._incoming.block(number), self._outgoing.block(number)
        place, states = self._order.place, self._distinguishable_states
        swapped = await self._right.perform(joined(names, kept, place, states))
        self._under_way.end(number)
        await self._right.carry_out(self._outgoing.say(number, swapped))

    async def _pass_on(self, number: int, turn: Turn, has_come: asyncio.Event) -> None:
        """Pass on all that others tell of their swaps."""
        await together(
            self._pass_right(number, turn, has_come), self._pass_left(number, turn, has_come)
        )
        turn.require()

    async def _pass_right(self, number: int, turn: Turn, has_come: asyncio.Event) -> None:
        """Pass the bits of all swaps to the left on, as they come."""
        missing = to_the_left_of(self._order.place)
        while missing:
            swapped = await self._left.perform(self._incoming.swapped(number, missing))
            await self._right.carry_out(self._outgoing.say(number, swapped))
            turn.heard(swapped.place)
            if turn.has_come:
                has_come.set()

    async def _pass_left(self, number: int, turn: Turn, has_come: asyncio.Event) -> None:
        """Pass notices of swaps to the right on, as they come; one may be for this place."""
        for _ in range(self._order.notices):
            place, waiting = await self._right.perform(self._outgoing.notice(number))
            if turn.noticed(place, waiting):
                await self._left.carry_out(self._incoming.notify(number, place, waiting))
            if turn.has_come:
                has_come.set()

    async def _join(self, number: int, kept: tuple[Kept, Kept], has_come: asyncio.Event) -> None:
        """Swap when it is this repeater's turn, and tell those who have to know.

        Whoever hears of the others has a deadline.
        """
        order = self._order
        await has_come.wait()
        await self._tell_of_swap(number, kept)
        if order.tell_left:
            notice = self._incoming.notify(number, order.place, order.tell_left)
            await self._left.carry_out(notice)


async def together(one: Coroutine[Any, Any, A], other: Coroutine[Any, Any, B]) -> tuple[A, B]:
    """Return the results of both; as soon as one fails, cancel the other and raise its error."""
    tasks = asyncio.create_task(one), asyncio.create_task(other)
    try:
        return await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
