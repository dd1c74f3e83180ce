"""The orders of this host to the dispatcher: one stream, many orders at a time."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Collection
from itertools import count
from math import inf
from typing import NamedTuple

import grpc

from hosts.hardware.replies import HardwareError, NoLight, NotHere
from hosts.timeouts import DISPATCHER_TIMEOUT_S
from wire.dispatcher_pb2 import BlockId, ChallengeRequest, Feedback, Order, Outcome, Step
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import proving, slot_of
from wire.network_time import REAL_TIME, LinkCounts, NetworkTime, SteppedTime


class Waiting(NamedTuple):
    """An order without an answer."""

    answer: asyncio.Future[Outcome]
    until_s: float  # of the event loop's clock
    steps: tuple[Step, ...]


class Chain:
    """Orders that follow each other, and of which nothing is heard but what has failed."""

    def __init__(self, orders: "Orders", number: int) -> None:
        self._orders, self.number = orders, number
        self.fault: HardwareError | None = None

    def begin(self, *steps: Step) -> None:
        """Have steps done when those before are; raise HardwareError if one has failed."""
        if self.fault is not None:
            raise self.fault
        self._orders.write(Order(number=self.number, steps=steps, follows=True, quiet=True))

    async def over(self) -> None:
        """Wait until all is done; raise HardwareError if something has failed."""
        if self.fault is None:
            await self._orders.perform_behind(self.number)
        if self.fault is not None:
            raise self.fault


class Standing:
    """An order that is repeated for blocks that follow each other, with an outcome for each."""

    def __init__(self, orders: "Orders", order: Order, next_number: int) -> None:
        self._orders, self._order = orders, order
        self.next_number = next_number  # of the block whose outcome is the next
        self.left = order.times
        self._early: deque[Outcome] = deque()  # nobody has asked for them yet

    def came(self, outcome: Outcome) -> None:
        """Keep an outcome for which nobody waits."""
        self._early.append(outcome)

    async def next(self) -> list[Feedback]:
        """Wait for the next outcome; raise HardwareError if there is no light, or a fault."""
        self.left -= 1
        self.next_number += 1
        number = self._order.number
        outcome = self._early.popleft() if self._early else await self._orders.answer_to(number)
        if outcome.code:
            self.left = 0
            raise _fault(outcome, tuple(self._order.steps))
        if not self.left:
            self._orders.forget(number)
        return list(outcome.feedbacks)

    def end(self) -> None:
        self._orders.forget(self._order.number, cancel=self.left > 0)


class Orders:
    def __init__(
        self, stub: DispatcherStub, token: str, network_time: NetworkTime = REAL_TIME
    ) -> None:
        self._stub = stub
        self._time = network_time
        self._counts = LinkCounts(network_time)
        self._token = token
        self._numbers = count(1)
        self._waiting: dict[int, Waiting] = {}
        self._chains: dict[int, Chain] = {}
        self._repeated: dict[int, Standing] = {}
        self._watch: asyncio.TimerHandle | None = None  # of the oldest, or of one before it
        self._closed = False
        self.connected = asyncio.Event()  # the dispatcher has answered
        self._outgoing: asyncio.Queue[Order] = asyncio.Queue()
        self._stream: asyncio.Task[None] | None = None

    async def perform(self, *steps: Step) -> list[Feedback]:
        """Have steps done in order; raise HardwareError if one of them fails."""
        outcome = await self._outcome(Order(number=next(self._numbers), steps=steps))
        if outcome.code:
            raise _fault(outcome, steps)
        return list(outcome.feedbacks)

    def chain(self) -> Chain:
        """Return a new chain of orders, until it is forgotten."""
        number = next(self._numbers)
        self._chains[number] = Chain(self, number)
        return self._chains[number]

    def forget_chain(self, chain: Chain) -> None:
        """Give a chain up: nothing is heard of it any more."""
        del self._chains[chain.number]

    async def perform_behind(self, number: int) -> None:
        """Wait until the orders of a chain are over."""
        await self._outcome(Order(number=number, follows=True))

    def repeat(self, times: int, block: int, *steps: Step) -> Standing:
        """Have steps done again and again, of blocks that follow each other from this one on."""
        order = Order(number=next(self._numbers), steps=steps, times=times)
        self.write(order)
        self._repeated[order.number] = Standing(self, order, block)
        return self._repeated[order.number]

    def forget(self, number: int, cancel: bool = False) -> None:
        """Hear of a repeated order no more; end it if it is not over."""
        if self._repeated.pop(number, None) is not None and cancel:
            self._cancel(number)

    async def _outcome(self, order: Order) -> Outcome:
        self.write(order)
        return await self.answer_to(order.number, tuple(order.steps))

    async def answer_to(self, number: int, steps: tuple[Step, ...] = ()) -> Outcome:
        """Wait for the outcome of an order that was sent; if nobody waits any more, cancel it."""
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[Outcome] = loop.create_future()
        self._waiting[number] = Waiting(answer, loop.time() + DISPATCHER_TIMEOUT_S, steps)
        if self._watch is None:  # one timer for all costs each of them less
            self._watch = loop.call_later(DISPATCHER_TIMEOUT_S, self._look)
        try:
            return await answer
        except asyncio.CancelledError:
            self._cancel(number)
            raise
        finally:
            del self._waiting[number]
            if not self._waiting and isinstance(self._time, SteppedTime) and self._watch:
                self._watch.cancel()  # else time would leap to it
                self._watch = None

    def give_up(self, blocks: Collection[BlockId]) -> None:
        """Say that light of these blocks which orders still wait for is lost.

        The dispatcher knows whether it is: an order that has its light is answered by what it does.
        """
        for number, waiting in self._waiting.items():
            if any(
                step.receive.block in blocks for step in waiting.steps if step.HasField("receive")
            ):
                self._put(Order(number=number, lost=True))

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
        next_s = inf
        for number, (answer, until_s, _steps) in self._waiting.items():
            if until_s > loop.time():
                next_s = min(next_s, until_s)
            elif not answer.done():
                self._cancel(number)
                text = f"dispatcher: no answer in {DISPATCHER_TIMEOUT_S:g} s"
                answer.set_exception(HardwareError(text))
        if next_s < inf:
            self._watch = loop.call_at(next_s, self._look)

    @property
    def _open(self) -> bool:
        return self._stream is not None and not self._stream.done()

    def _cancel(self, number: int) -> None:
        """Tell the dispatcher that nobody waits for an order any more."""
        if self._open and not self._closed:
            self._put(Order(number=number, cancel=True))

    def write(self, order: Order) -> None:
        """Send an order; raise HardwareError if there is no way any more."""
        if self._closed:
            raise HardwareError("the QNIC is closed")
        self.open()
        self._put(order)

    def _put(self, order: Order) -> None:
        self._counts.sent()
        self._outgoing.put_nowait(order)

    def open(self) -> None:
        if not self._open:
            self._outgoing = asyncio.Queue()
            self._stream = asyncio.create_task(self._run(self._outgoing))

    async def _run(self, outgoing: asyncio.Queue[Order]) -> None:
        """Hand out outcomes; when the stream ends, nobody may go on waiting."""
        problem, call = "it has ended", None
        try:
            proof = await proved(self._stub, self._token, "Perform")
            self.connected.set()
            proof = (*proof, *slot_of(self._time))
            call = self._stub.Perform(self._each(outgoing), metadata=proof, wait_for_ready=True)
            async for outcome in call:
                self._counts.taken()
                if outcome.code and (chain := self._chains.get(outcome.number)) is not None:
                    chain.fault = chain.fault or _fault(outcome, ())
                waiting = self._waiting.get(outcome.number)
                if waiting is not None and not waiting.answer.done():
                    waiting.answer.set_result(outcome)
                elif (repeated := self._repeated.get(outcome.number)) is not None:
                    repeated.came(outcome)
        except grpc.aio.AioRpcError as error:
            problem = problem_of(error)
        finally:
            self._counts.ended()
            if call is not None:
                call.cancel()
            for answer, *_rest in self._waiting.values():
                if not answer.done():
                    answer.set_exception(HardwareError(f"dispatcher: {problem}"))
            for repeated in self._repeated.values():
                code = grpc.StatusCode.UNAVAILABLE.value[0]
                repeated.came(Outcome(code=code, text=problem))

    async def _each(self, orders: asyncio.Queue[Order]) -> AsyncIterator[Order]:
        while True:
            order = await orders.get()
            yield order


async def proved(stub: DispatcherStub, token: str, method: str) -> tuple[tuple[str, str], ...]:
    """Return the metadata of one call to the dispatcher; the token itself does not go out."""
    reply = await stub.Challenge(
        ChallengeRequest(), wait_for_ready=True, timeout=DISPATCHER_TIMEOUT_S
    )
    return proving(token, reply.nonce, method)


def problem_of(error: grpc.aio.AioRpcError) -> str:
    if error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
        return f"no answer in {DISPATCHER_TIMEOUT_S:g} s"
    return f"{error.code().name}: {error.details()}"


def _fault(outcome: Outcome, steps: tuple[Step, ...]) -> HardwareError:
    code = outcome.code
    receives = steps and steps[0].HasField("receive")
    if code == grpc.StatusCode.DEADLINE_EXCEEDED.value[0] and receives:
        return NoLight(outcome.text)
    if code in (grpc.StatusCode.NOT_FOUND.value[0], grpc.StatusCode.PERMISSION_DENIED.value[0]):
        return NotHere(f"dispatcher: {outcome.text}")
    return HardwareError(f"dispatcher: {outcome.text}")
