"""The orders of one host: they run side by side, the steps of each one after the other."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from typing import Any

import grpc

from dispatcher import limits
from dispatcher.refusal import Refusal, exhausted, invalid
from wire.dispatcher_pb2 import Feedback, Order, Outcome

Act = Callable[[str, Any], Awaitable[Feedback]]
Write = Callable[[Outcome], Awaitable[None]]


class Orders:
    """One call of Perform."""

    def __init__(self, act: Act, write: Write) -> None:
        """Do each step by `act`, answer by `write`."""
        self._act = act
        self._write = write
        self._writing = asyncio.Lock()
        self._running: dict[int, asyncio.Task[None]] = {}

    async def run(self, orders: AsyncIterator[Order]) -> None:
        """Take orders until there are no more, and end when all are answered."""
        async with asyncio.TaskGroup() as group:
            async for order in orders:
                running = self._running.get(order.number)
                if order.cancel:
                    if running is not None:
                        running.cancel()
                elif running is not None:
                    problem = f"order {order.number} is still running; number them apart"
                    await self._answer(_refused(order, invalid(problem)))
                elif len(self._running) >= limits.MAX_ORDERS:
                    problem = f"{limits.MAX_ORDERS} orders are running; wait for an outcome"
                    await self._answer(_refused(order, exhausted(problem)))
                else:
                    task = group.create_task(self._perform(order))
                    self._running[order.number] = task
                    task.add_done_callback(partial(self._ended, order.number))

    def _ended(self, number: int, _task: asyncio.Task[None]) -> None:
        del self._running[number]

    async def _perform(self, order: Order) -> None:
        try:
            outcome = Outcome(number=order.number, feedbacks=await self._steps(order))
        except Refusal as refusal:
            outcome = _refused(order, refusal)
        await self._answer(outcome)

    async def _answer(self, outcome: Outcome) -> None:
        try:
            await asyncio.shield(self._write_whole(outcome))
        except grpc.aio.InternalError:
            return  # the host went away

    async def _write_whole(self, outcome: Outcome) -> None:
        async with self._writing:
            await self._write(outcome)

    async def _steps(self, order: Order) -> list[Feedback]:
        limits.require_steps(len(order.steps))
        feedbacks = []
        for step in order.steps:
            kind = step.WhichOneof("operation")
            if kind is None:
                raise invalid("a step without an operation; name one")
            feedbacks.append(await self._act(kind, getattr(step, kind)))
        return feedbacks


def _refused(order: Order, refusal: Refusal) -> Outcome:
    return Outcome(number=order.number, code=refusal.code.value[0], text=str(refusal))
