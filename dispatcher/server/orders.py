"""The orders of one host: they run side by side, the steps of each one after the other."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Any, cast

import grpc

from dispatcher.operations import limits
from dispatcher.refusal import Refusal, exhausted, invalid
from wire.dispatcher_pb2 import Feedback, Order, Outcome

Act = Callable[[str, Any], Awaitable[Feedback]]
Write = Callable[[Outcome], Awaitable[None]]
Settled = Callable[[], Awaitable[None]]
LIGHT = "receive"  # the kind of a step that waits for light


class Orders:
    """One call of Perform."""

    def __init__(self, act: Act, write: Write, settled: Settled) -> None:
        """Do each step by `act`, answer by `write`; `settled`: light that is due has come."""
        self._act = act
        self._write = write
        self._settled = settled
        self._running: dict[int, asyncio.Task[None]] = {}
        self._repeated: set[int] = set()  # numbers of orders that go on when they are answered
        self._receiving: dict[int, asyncio.Timeout] = {}  # those that wait for light
        self._unanswered = 0
        self._writing = asyncio.Lock()

    async def run(self, orders: AsyncIterator[Order]) -> None:
        """Take orders until there are no more, and end when all are answered."""
        async with asyncio.TaskGroup() as group:
            async for order in orders:
                await self._take(order, group)

    async def _take(self, order: Order, group: asyncio.TaskGroup) -> None:
        running = self._running.get(order.number)
        if order.cancel:
            self._repeated.discard(order.number)
            if running is not None:
                running.cancel()
        elif order.lost:
            await asyncio.sleep(0)  # an order that came just before looks for its light first
            await self._settled()
            if order.number in self._receiving:
                self._receiving[order.number].reschedule(asyncio.get_running_loop().time())
        elif order.number in self._repeated or (running is not None and not order.follows):
            problem = f"order {order.number} is still running; number them apart"
            await self._answer(_refused(order, invalid(problem)))
        elif self._unanswered >= limits.MAX_ORDERS:
            problem = f"{limits.MAX_ORDERS} orders are running; wait for an outcome"
            await self._answer(_refused(order, exhausted(problem)))
        else:
            task = group.create_task(self._perform_all(order, running))
            self._running[order.number] = task
            self._unanswered += 1
            task.add_done_callback(partial(self._ended, order.number))

    def _ended(self, number: int, task: asyncio.Task[None]) -> None:
        self._unanswered -= 1
        if self._running.get(number) is task:  # it was cancelled
            del self._running[number]

    async def _perform_all(self, order: Order, before: asyncio.Task[None] | None) -> None:
        """Perform an order when the one before it is over, as often as it says."""
        if order.times > 1:
            self._repeated.add(order.number)
        try:
            while await self._perform(order, before) and order.number in self._repeated:
                self._running[order.number] = cast("asyncio.Task[None]", asyncio.current_task())
                order, before = _of_next_blocks(order), None
        finally:
            self._repeated.discard(order.number)

    async def _perform(self, order: Order, before: asyncio.Task[None] | None) -> bool:
        """Perform an order once; return whether there may be a next time."""
        try:
            if before is not None:
                await asyncio.wait([before])
            outcome = Outcome(number=order.number, feedbacks=await self._steps(order))
        except Refusal as refusal:
            outcome = _refused(order, refusal)
        if self._running.get(order.number) is asyncio.current_task():  # no other follows it
            del self._running[order.number]  # a message is written whole: no cancelling it
        if outcome.code or not order.quiet:
            await self._answer(outcome)
        return not outcome.code and order.times > 1

    async def _answer(self, outcome: Outcome) -> None:
        """Write outcomes one after the other; a host that has gone away needs none."""
        async with self._writing:
            with suppress(grpc.aio.InternalError):
                await self._write(outcome)

    async def _steps(self, order: Order) -> list[Feedback]:
        if order.steps or not order.follows:
            limits.require_steps(len(order.steps))
        limits.require_times(order)
        feedbacks = []
        for step in order.steps:
            kind = step.WhichOneof("operation")
            if kind is None:
                raise invalid("a step without an operation; name one")
            do = self._act(kind, getattr(step, kind))
            feedbacks.append(await (self._received(order.number, do) if kind == LIGHT else do))
        return feedbacks

    async def _received(self, number: int, receive: Awaitable[Feedback]) -> Feedback:
        """Wait for light, until it is said to be lost."""
        try:
            async with asyncio.timeout(None) as self._receiving[number]:
                return await receive
        except TimeoutError:
            raise Refusal(grpc.StatusCode.DEADLINE_EXCEEDED, "the light is lost") from None
        finally:
            self._receiving.pop(number, None)


def _of_next_blocks(order: Order) -> Order:
    """Return what is left of an order that was performed once."""
    left = Order(number=order.number, steps=order.steps, quiet=order.quiet, times=order.times - 1)
    for step in left.steps:
        if step.HasField("receive"):
            step.receive.block.number += 1
        else:
            step.bell_measure.first.number += 1
            step.bell_measure.second.number += 1
    return left


def _refused(order: Order, refusal: Refusal) -> Outcome:
    return Outcome(number=order.number, code=refusal.code.value[0], text=str(refusal))
