"""What a repeater does: a link to either side, and Bell measurements between them."""

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

import numpy as np

from hosts.hardware.qnic import Qnic, Symbols
from hosts.middleware.services.blocks import take
from hosts.middleware.swapping.bits import Bits
from hosts.middleware.swapping.link import IncomingLink, OutgoingLink
from wire.device import SwapOrder

A = TypeVar("A")
B = TypeVar("B")


class Repeater:
    """Joins the links to its left and to its right."""

    def __init__(
        self,
        qnic: Qnic,
        links: tuple[IncomingLink, OutgoingLink],
        order: SwapOrder,
        told_apart: frozenset[int],
    ) -> None:
        """Join two open links as ordered; these Bell states are told apart here."""
        self._qnic, self._order, self._told_apart = qnic, order, told_apart
        self._left, self._right = links

    async def run(self) -> None:
        """Swap block after block until the opener ends it; raise SessionError if it fails."""
        while (coming := await self._left.announced()) is not None:
            await self._swap(*coming)
        await self._right.finish()
        self._left.agree()

    async def _swap(self, number: int, size: int) -> None:
        left, right = await together(self._left.take(number, size), self._right.make(number, size))
        if self._order.after_left:
            bits = await self._bits_of_left(number, left)
            bits = bits.joined(await self._measure(number, left, right))
        else:
            own = await self._measure(number, left, right)
            bits = (await self._bits_of_left(number, left)).joined(own)
        self._right.say(number, bits)

    async def _bits_of_left(self, number: int, pairs: int) -> Bits:
        if self._order.place > 1:
            return await self._left.hear(number, pairs)
        return Bits(np.ones(pairs, dtype=bool), np.zeros(pairs, dtype=np.uint8))

    async def _measure(self, number: int, left: int, right: int) -> Bits:
        """Join the first pairs of both sides, and let go of the rest of either."""
        size = min(left, right)
        names = self._left.block(number), self._right.block(number)
        for name, there in zip(names, (left, right), strict=True):
            if size < there:
                await take(self._qnic, name, {name: np.arange(size)})
        outcomes: Symbols = np.zeros(0, dtype=np.uint8)
        if size:
            outcomes = await self._qnic.bell_measure(*names)
        return Bits.told(outcomes, self._told_apart)


async def together(one: Coroutine[Any, Any, A], other: Coroutine[Any, Any, B]) -> tuple[A, B]:
    """Return the results of both; as soon as one fails, cancel the other and raise its error."""
    tasks = asyncio.create_task(one), asyncio.create_task(other)
    try:
        return await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
