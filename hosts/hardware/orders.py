"""The orders of this host to the dispatcher: one stream, many orders at a time."""

import asyncio
from collections.abc import AsyncIterator
from itertools import count

import grpc

from hosts.hardware.qnic import HardwareError, NoLight
from hosts.timeouts import DISPATCHER_TIMEOUT_S
from wire.dispatcher_pb2 import ChallengeRequest, Feedback, Order, Outcome, Step
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import proving


class NotHere(HardwareError):
    """A block is not at this host."""


class Orders:
    """Sends orders and hands each outcome to whoever waits for it."""

    def __init__(self, stub: DispatcherStub, token: str) -> None:
        self._stub = stub
        self._token = token
        self._numbers = count(1)
        self._waiting: dict[int, asyncio.Future[Outcome]] = {}
        self._closed = False
        self._outgoing: asyncio.Queue[Order] = asyncio.Queue()
        self._stream: asyncio.Task[None] | None = None

    async def perform(self, *steps: Step) -> list[Feedback]:
        """Have steps done in order; raise HardwareError if one of them fails."""
        number = next(self._numbers)
        answer: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            async with asyncio.timeout(DISPATCHER_TIMEOUT_S):
                self._write(Order(number=number, steps=steps))
                outcome = await answer
        except TimeoutError as error:
            self._cancel(number)
            raise HardwareError(f"dispatcher: no answer in {DISPATCHER_TIMEOUT_S:g} s") from error
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
        if self._stream is not None:
            self._stream.cancel()
            await asyncio.wait([self._stream])

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
                answer = self._waiting.get(outcome.number)
                if answer is not None and not answer.done():
                    answer.set_result(outcome)
        except grpc.aio.AioRpcError as error:
            problem = f"{error.code().name}: {error.details()}"
        finally:
            if call is not None:
                call.cancel()
            for answer in self._waiting.values():
                if not answer.done():
                    answer.set_exception(HardwareError(f"dispatcher: {problem}"))


async def proved(stub: DispatcherStub, token: str, method: str) -> tuple[tuple[str, str], ...]:
    """Return the metadata of one call to the dispatcher; the token itself does not go out."""
    reply = await stub.Challenge(
        ChallengeRequest(), wait_for_ready=True, timeout=DISPATCHER_TIMEOUT_S
    )
    return proving(token, reply.nonce, method)


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
