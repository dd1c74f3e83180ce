"""The orders of this host to the dispatcher: one stream, many orders at a time."""

import asyncio
from collections.abc import AsyncIterator, Collection
from itertools import count
from typing import NamedTuple

import grpc

from hosts.hardware.qnic import HardwareError, NoLight
from hosts.timeouts import DISPATCHER_TIMEOUT_S
from wire.dispatcher_pb2 import BlockId, ChallengeRequest, Feedback, Order, Outcome, Step
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import proving


class NotHere(HardwareError):
    """A block is not at this host."""


class Waiting(NamedTuple):
    """An order without an answer."""

    answer: asyncio.Future[Outcome]
    until_s: float  # of the event loop's clock
    steps: tuple[Step, ...]


class Orders:
    """Sends orders and hands each outcome to whoever waits for it."""

    def __init__(self, stub: DispatcherStub, token: str) -> None:
        self._stub = stub
        self._token = token
        self._numbers = count(1)
        self._waiting: dict[int, Waiting] = {}  # the oldest first
        self._watch: asyncio.TimerHandle | None = None  # of the oldest, or of one before it
        self._closed = False
        self._outgoing: asyncio.Queue[Order] = asyncio.Queue()
        self._stream: asyncio.Task[None] | None = None

    async def perform(self, *steps: Step) -> list[Feedback]:
        """Have steps done in order; raise HardwareError if one of them fails."""
        number, loop = next(self._numbers), asyncio.get_running_loop()
        answer: asyncio.Future[Outcome] = loop.create_future()
        self._waiting[number] = Waiting(answer, loop.time() + DISPATCHER_TIMEOUT_S, steps)
        if self._watch is None:  # one timer for all costs each of them less
            self._watch = loop.call_later(DISPATCHER_TIMEOUT_S, self._look)
        try:
            self._write(Order(number=number, steps=steps))
            outcome = await answer
        except asyncio.CancelledError:
            self._cancel(number)
            raise
        finally:
            del self._waiting[number]
        if outcome.code:
            raise _fault(outcome, steps)
        return list(outcome.feedbacks)

    def give_up(self, blocks: Collection[BlockId]) -> None:
        """Say that light of these blocks which orders still wait for is lost.

        The dispatcher knows whether it is: an order that has its light is answered by what it does.
        """
        for number, waiting in self._waiting.items():
            if any(
                step.receive.block in blocks for step in waiting.steps if step.HasField("receive")
            ):
                self._outgoing.put_nowait(Order(number=number, lost=True))

    async def close(self) -> None:
        """End the stream; there is no other after it."""
        self._closed = True
        if self._watch is not None:
            self._watch.cancel()
        if self._stream is not None:
            self._stream.cancel()
            await asyncio.wait([self._stream])

    def _look(self) -> None:
        """Give up what has waited for too long, and look again when the next has."""
        loop, self._watch = asyncio.get_running_loop(), None
        for number, (answer, until_s, _steps) in self._waiting.items():
            if until_s > loop.time():
                self._watch = loop.call_at(until_s, self._look)
                return
            if not answer.done():
                self._cancel(number)
                text = f"dispatcher: no answer in {DISPATCHER_TIMEOUT_S:g} s"
                answer.set_exception(HardwareError(text))

    @property
    def _open(self) -> bool:
        return self._stream is not None and not self._stream.done()

    def _cancel(self, number: int) -> None:
        """Tell the dispatcher that nobody waits for an order any more."""
        if self._open and not self._closed:
            self._outgoing.put_nowait(Order(number=number, cancel=True))

    def _write(self, order: Order) -> None:
        if self._closed:
            raise HardwareError("the QNIC is closed")
        if not self._open:
            self._outgoing = asyncio.Queue()
            self._stream = asyncio.create_task(self._run(self._outgoing))
        self._outgoing.put_nowait(order)

    async def _run(self, outgoing: asyncio.Queue[Order]) -> None:
        """Hand out outcomes; when the stream ends, nobody may go on waiting."""
        problem, call = "it has ended", None
        try:
            proof = await proved(self._stub, self._token, "Perform")
            call = self._stub.Perform(_each(outgoing), metadata=proof, wait_for_ready=True)
            async for outcome in call:
                waiting = self._waiting.get(outcome.number)
                if waiting is not None and not waiting.answer.done():
                    waiting.answer.set_result(outcome)
        except grpc.aio.AioRpcError as error:
            problem = problem_of(error)
        finally:
            if call is not None:
                call.cancel()
            for answer, *_rest in self._waiting.values():
                if not answer.done():
                    answer.set_exception(HardwareError(f"dispatcher: {problem}"))


async def proved(stub: DispatcherStub, token: str, method: str) -> tuple[tuple[str, str], ...]:
    """Return the metadata of one call to the dispatcher; the token itself does not go out."""
    reply = await stub.Challenge(
        ChallengeRequest(), wait_for_ready=True, timeout=DISPATCHER_TIMEOUT_S
    )
    return proving(token, reply.nonce, method)


def problem_of(error: grpc.aio.AioRpcError) -> str:
    """Return why the dispatcher has not done something."""
    if error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
        return f"no answer in {DISPATCHER_TIMEOUT_S:g} s"
    return f"{error.code().name}: {error.details()}"


async def _each(orders: asyncio.Queue[Order]) -> AsyncIterator[Order]:
    """Give orders as they come, for ever."""
    while True:
        yield await orders.get()


def _fault(outcome: Outcome, steps: tuple[Step, ...]) -> HardwareError:
    code = outcome.code
    if code == grpc.StatusCode.DEADLINE_EXCEEDED.value[0] and steps[0].HasField("receive"):
        return NoLight(outcome.text)
    if code in (grpc.StatusCode.NOT_FOUND.value[0], grpc.StatusCode.PERMISSION_DENIED.value[0]):
        return NotHere(f"dispatcher: {outcome.text}")
    return HardwareError(f"dispatcher: {outcome.text}")
