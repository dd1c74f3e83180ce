"""The gRPC service (wire/dispatcher.proto): one call is look up, act, reply."""

# gRPC names the methods.
# ruff: noqa: N802

import asyncio
import functools
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar, cast

import grpc

from dispatcher.layer.journal import CausedBy
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.operations import limits
from dispatcher.operations.request_table import RequestTable
from dispatcher.refusal import Refusal, denied, exhausted, invalid
from dispatcher.sabot.dense import TooLarge
from dispatcher.server.callers import Callers
from dispatcher.server.turns import Turns
from dispatcher.timeouts import MAX_PAUSE_S
from wire import dispatcher_pb2 as messages
from wire.dispatcher_pb2 import Feedback, Order, Outcome
from wire.dispatcher_pb2_grpc import DispatcherServicer
from wire.dispatcher_service import slot
from wire.network_time import LinkCounts

Act = Callable[[str, Any], Awaitable[Feedback]]
Write = Callable[[Outcome], Awaitable[None]]
Settled = Callable[[], Awaitable[None]]
LIGHT = "receive"  # the kind of a step that waits for light


class Orders:
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
        """Wait for light, until it is reported as lost."""
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


Request = TypeVar("Request")
Reply = TypeVar("Reply")
Context = grpc.aio.ServicerContext[Any, Any]
Failed = Callable[[BaseException], None]
CERTIFIED = "x509_common_name"  # of a caller, as gRPC has it


def call(
    method: Callable[["Service", Request, str, Context], Awaitable[Reply]],
) -> Callable[["Service", Request, Context], Awaitable[Reply]]:
    """Give the method the caller's node, and turn a refusal into the call's status."""

    @functools.wraps(method)
    async def answer(service: "Service", request: Request, context: Context) -> Reply:
        try:
            metadata = dict(context.invocation_metadata() or ())
            certified = context.auth_context().get(CERTIFIED)
            node = service.callers.of_call(metadata, context.peer(), method.__name__, certified)
            return await method(service, request, node, context)
        except Refusal as refusal:
            await context.abort(refusal.code, str(refusal))
        except Exception as error:
            service.failed(error)
            raise

    return answer


class Service(DispatcherServicer):
    def __init__(
        self, layer: PhysicalLayer, callers: Callers, failed: Failed, state_inspection: bool = False
    ) -> None:
        """Serve this layer; call `failed` with any error that is not a refusal."""
        self.state_inspection = state_inspection
        self.callers, self.failed = callers, failed
        self.layer = layer
        self.table = RequestTable(layer, failed)
        self.turns = Turns(layer.time)

    async def Challenge(
        self, _request: messages.ChallengeRequest, context: Context
    ) -> messages.ChallengeReply:
        return messages.ChallengeReply(nonce=self.callers.challenges.give(context.peer()))

    @call
    async def Perform(
        self, orders: AsyncIterator[messages.Order], node: str, context: Context
    ) -> None:
        self.callers.require_host(node)
        act = functools.partial(self.change, node)
        counts = LinkCounts(self.layer.time, slot(context.invocation_metadata()))

        async def write(outcome: messages.Outcome) -> None:
            counts.sent()
            await context.write(outcome)

        try:
            requests = self._asked(orders, counts, node)
            await Orders(act, write, self.table.transport.settled).run(requests)
        finally:
            counts.ended()

    async def _asked(
        self, orders: AsyncIterator[messages.Order], counts: LinkCounts, node: str
    ) -> AsyncIterator[messages.Order]:
        """Write the arrival time of each order into its steps."""
        taken = _counted(orders, counts)
        async for order in self._in_turn(taken, node) if self.turns.is_ordered else taken:
            now_ns = self.layer.clock.now_ns()
            for step in order.steps:
                name = step.WhichOneof("operation")
                if name is not None and self.table.rows[name].has_time:
                    getattr(step, name).asked_ns = now_ns
            yield order

    async def _in_turn(
        self, orders: AsyncIterator[messages.Order], node: str
    ) -> AsyncIterator[messages.Order]:
        """Yield all orders of one instant when it is this node's turn."""
        came: asyncio.Queue[messages.Order | None] = asyncio.Queue()
        reading = asyncio.create_task(_read(orders, came))
        try:
            while (order := await came.get()) is not None:
                await self.turns.turn(node)
                yield order
                while not came.empty():
                    if (order := came.get_nowait()) is None:
                        return
                    yield order
        finally:
            reading.cancel()
            await asyncio.wait([reading])

    @call
    async def Look(
        self, request: messages.LookRequest, node: str, _context: Context
    ) -> messages.LookReply:
        self.callers.require_host(node)
        if not self.state_inspection:
            raise denied("no state can be looked at in this network, as in none of hardware")
        return cast(messages.LookReply, await self.change(node, "look", request))

    async def change(self, node: str, kind: str, request: Any) -> Any:
        """Handle and record a request that the caller may make; return the reply."""
        try:
            with self.layer.journal.request(node, kind, request), CausedBy(node, kind, request):
                return await self.table.handle(node, kind, request)
        except TooLarge as error:
            raise exhausted(str(error)) from error

    @call
    async def TunePort(
        self, request: messages.TunePortRequest, node: str, _context: Context
    ) -> messages.TunePortReply:
        self.callers.require_agent(node, request.switch, "tune a port of")
        return messages.TunePortReply(ready_ns=await self.change(node, "tune_port", request))

    @call
    async def Emit(
        self, request: messages.EmitRequest, node: str, _context: Context
    ) -> messages.EmitReply:
        self.callers.require_agent(node, request.switch, "emit from a source of")
        return cast(messages.EmitReply, await self.change(node, "emit", request))

    @call
    async def Keep(
        self, request: messages.KeepRequest, node: str, _context: Context
    ) -> messages.KeepReply:
        self.callers.require_agent(node, request.switch, "choose pulses in a memory of")
        return cast(messages.KeepReply, await self.change(node, "keep", request))

    @call
    async def SwitchStatistics(
        self, request: messages.SwitchStatisticsRequest, node: str, _context: Context
    ) -> messages.SwitchStatisticsReply:
        self.callers.require_reader(node, request.switch)
        reply = self.table.switching.statistics(request.switch)
        reply.memories.extend(self.table.memories.states(request.switch))
        reply.analysers.extend(self.table.reports.counts(request.switch))
        return reply

    @call
    async def WatchSwitch(
        self, request: messages.WatchSwitchRequest, node: str, context: Context
    ) -> None:
        self.callers.require_reader(node, request.switch)
        with self.table.switching.watching(request.switch) as conditions:
            async for condition in conditions:
                try:
                    await context.write(condition)
                except grpc.aio.InternalError:
                    return  # the watcher went away

    @call
    async def WatchAnalysers(
        self, request: messages.WatchSwitchRequest, node: str, context: Context
    ) -> None:
        self.callers.require_reader(node, request.switch)
        with self.table.reports.watching(request.switch) as reports:
            await context.send_initial_metadata(())  # from here on none is missed
            async for report in reports:
                try:
                    await context.write(report)
                except grpc.aio.InternalError:
                    return  # the watcher went away

    @call
    async def InjectFault(
        self, request: messages.InjectFaultRequest, node: str, _context: Context
    ) -> messages.InjectFaultReply:
        self.callers.require_runner(node, "inject faults")
        self.callers.require_known(request.switch)
        await self.change(node, "inject_fault", request)
        return messages.InjectFaultReply()

    @call
    async def AdjustFiber(
        self, request: messages.AdjustFiberRequest, node: str, _context: Context
    ) -> messages.AdjustFiberReply:
        self.callers.require_runner(node, "adjust fibres")
        fibers = await self.change(node, "adjust_fiber", request)
        return messages.AdjustFiberReply(fibers=fibers)

    @call
    async def AdjustMemory(
        self, request: messages.AdjustMemoryRequest, node: str, _context: Context
    ) -> messages.AdjustMemoryReply:
        self.callers.require_runner(node, "adjust memories")
        return cast(messages.AdjustMemoryReply, await self.change(node, "adjust_memory", request))

    @call
    async def Status(
        self, request: messages.StatusRequest, node: str, _context: Context
    ) -> messages.StatusReply:
        self.callers.require_runner(node, "ask for the status")
        reply = self.status()
        held = self.layer.ownership.at_node(request.blocks_at)
        reply.blocks.extend(self.layer.held(block) for block in held)
        return reply

    def status(self) -> messages.StatusReply:
        """Return how much there is, without the blocks."""
        return messages.StatusReply(
            live_qubits=self.layer.sabot.live_qubits,
            live_bytes=self.layer.sabot.live_bytes,
            pairs_created=self.table.blocks.pairs_created,
            photons_lost=self.layer.photons_lost,
            photons_lost_waiting=self.layer.photons_lost_waiting,
            drawn_for=self.layer.drawn_for,
            events=self.layer.history.count,
            backend=self.layer.sabot.backend,
            exact=self.layer.exact,
            approximations=[
                messages.Approximation(name=name, most=most)
                for name, most in self.layer.approximations.sizes.items()
            ],
        )

    @call
    async def Watch(self, request: messages.WatchRequest, node: str, context: Context) -> None:
        """Report events until the caller goes away: to the runner all, to a node its own."""
        watched = self.callers.watched_by(node, request.node)
        pause_s = min(request.pause_ms / 1000, MAX_PAUSE_S)
        with self.layer.history.watching(
            watched, request.session, request.history, request.per_qubit
        ) as watcher:
            while not (request.until_now and watcher.idle):
                events = messages.Events(events=await watcher.some())
                try:
                    await context.write(events)
                except grpc.aio.InternalError:
                    return  # the watcher went away
                if pause_s and watcher.idle:
                    await asyncio.sleep(pause_s)


async def _counted(
    orders: AsyncIterator[messages.Order], counts: LinkCounts
) -> AsyncIterator[messages.Order]:
    async for order in orders:
        counts.taken()
        yield order


async def _read(
    orders: AsyncIterator[messages.Order], came: asyncio.Queue[messages.Order | None]
) -> None:
    """Put what comes into the queue, and None behind it."""
    try:
        async for order in orders:
            came.put_nowait(order)
    finally:
        came.put_nowait(None)
