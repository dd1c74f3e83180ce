"""The orders of this host to the dispatcher: one stream, many orders at a time."""

import asyncio
from itertools import count
from typing import Any

import grpc

from hosts.hardware.qnic import HardwareError, NoLight
from wire.dispatcher_pb2 import Feedback, Order, Outcome, Step
from wire.dispatcher_pb2_grpc import DispatcherStub

ANSWER_TIMEOUT_S = 20.0


class NotHere(HardwareError):
    """A block is not at this host."""


class Orders:
    """Sends orders and hands each outcome to whoever waits for it."""

    def __init__(self, stub: DispatcherStub, token: str) -> None:
        self._stub = stub
        self._metadata = (("qmn-token", token),)
        self._numbers = count(1)
        self._waiting: dict[int, asyncio.Future[Outcome]] = {}
        self._writing = asyncio.Lock()
        self._closed = False
        self._cancelling: set[asyncio.Task[None]] = set()
        self._call: Any = None
        self._reading: asyncio.Task[None] | None = None

    async def perform(self, *steps: Step) -> list[Feedback]:
        """Have steps done in order; raise HardwareError if one of them fails."""
        number = next(self._numbers)
        answer: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                await self._write(Order(number=number, steps=steps))
                outcome = await answer
        except TimeoutError as error:
            self._cancel(number)
            raise HardwareError(f"dispatcher: no answer in {ANSWER_TIMEOUT_S:g} s") from error
        except asyncio.CancelledError:
            self._cancel(number)
            raise
        finally:
            del self._waiting[number]
        if outcome.code:
            raise _fault(outcome, steps)
        return list(outcome.feedbacks)

    async def close(self) -> None:
        """End the stream; there is no other after it."""
        self._closed = True
        if self._reading is not None:
            self._reading.cancel()
            self._call.cancel()

    def _cancel(self, number: int) -> None:
        """Tell the dispatcher that nobody waits for an order any more."""
        if self._reading is not None and not self._reading.done() and not self._closed:
            task = asyncio.create_task(self._write(Order(number=number, cancel=True)))
            self._cancelling.add(task)
            task.add_done_callback(self._cancelled)

    def _cancelled(self, task: asyncio.Task[None]) -> None:
        self._cancelling.discard(task)
        if not task.cancelled():
            task.exception()  # a stream that has ended needs no cancelling

    async def _write(self, order: Order) -> None:
        """Write an order; never interrupted half-way, because that would end the stream."""
        if self._closed:
            raise HardwareError("the QNIC is closed")
        if self._reading is None or self._reading.done():
            self._call = self._stub.Perform(metadata=self._metadata, wait_for_ready=True)
            self._reading = asyncio.create_task(self._read(self._call))
        await asyncio.shield(self._write_whole(self._call, order))

    async def _write_whole(self, call: Any, order: Order) -> None:
        async with self._writing:
            try:
                await call.write(order)
            except (grpc.aio.AioRpcError, asyncio.InvalidStateError) as error:
                raise HardwareError(f"dispatcher: {error}") from error
            except asyncio.CancelledError as error:
                raise HardwareError("dispatcher: the stream has ended") from error

    async def _read(self, call: Any) -> None:
        """Hand out outcomes; when the stream ends, nobody may go on waiting."""
        problem = "it has ended"
        try:
            async for outcome in call:
                answer = self._waiting.get(outcome.number)
                if answer is not None and not answer.done():
                    answer.set_result(outcome)
        except grpc.aio.AioRpcError as error:
            problem = f"{error.code().name}: {error.details()}"
        finally:
            for answer in self._waiting.values():
                if not answer.done():
                    answer.set_exception(HardwareError(f"dispatcher: {problem}"))


def _fault(outcome: Outcome, steps: tuple[Step, ...]) -> HardwareError:
    code = outcome.code
    if code == grpc.StatusCode.DEADLINE_EXCEEDED.value[0] and steps[0].HasField("receive"):
        return NoLight(outcome.text)
    if code in (grpc.StatusCode.NOT_FOUND.value[0], grpc.StatusCode.PERMISSION_DENIED.value[0]):
        return NotHere(f"dispatcher: {outcome.text}")
    return HardwareError(f"dispatcher: {outcome.text}")
