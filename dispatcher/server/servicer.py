"""The gRPC service (wire/dispatcher.proto): one call is look up, act, reply."""

# gRPC names the methods.
# ruff: noqa: N802

import asyncio
import functools
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, TypeVar, cast

import grpc

from dispatcher.layer.journal import CausedBy
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.operations.request_table import RequestTable
from dispatcher.refusal import Refusal, denied, exhausted
from dispatcher.sabot.dense import TooLarge
from dispatcher.server.callers import Callers
from dispatcher.server.orders import Orders
from dispatcher.timeouts import MAX_PAUSE_S
from wire import dispatcher_pb2 as messages
from wire.dispatcher_pb2_grpc import DispatcherServicer
from wire.dispatcher_service import slot
from wire.network_time import LinkCounts

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
    """Serves the nodes, the switches' agents and the runner."""

    def __init__(
        self, layer: PhysicalLayer, callers: Callers, failed: Failed, looking: bool = False
    ) -> None:
        """Serve this layer; call `failed` with any error that is not a refusal."""
        self.looking = looking
        self.callers, self.failed = callers, failed
        self.layer = layer
        self.table = RequestTable(layer, failed)

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
            asked = self._asked(orders, counts)
            await Orders(act, write, self.table.transport.settled).run(asked)
        finally:
            counts.ended()

    async def _asked(
        self, orders: AsyncIterator[messages.Order], counts: LinkCounts
    ) -> AsyncIterator[messages.Order]:
        """Write the arrival time of each order into its steps."""
        async for order in orders:
            counts.taken()
            now_ns = self.layer.clock.now_ns()
            for step in order.steps:
                name = step.WhichOneof("operation")
                if name is not None and self.table.rows[name].has_time:
                    getattr(step, name).asked_ns = now_ns
            yield order

    @call
    async def Look(
        self, request: messages.LookRequest, node: str, _context: Context
    ) -> messages.LookReply:
        self.callers.require_host(node)
        if not self.looking:
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
    async def SwitchStatistics(
        self, request: messages.SwitchStatisticsRequest, node: str, _context: Context
    ) -> messages.SwitchStatisticsReply:
        self.callers.require_reader(node, request.switch)
        return self.table.switching.statistics(request.switch)

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
            events=self.layer.history.count,
            backend=self.layer.sabot.backend,
            exact=self.layer.exact,
            approximations=[
                messages.Approximation(name=name, most=most)
                for name, most in self.layer.approximations.sizes.items()
            ],
            software=self.layer.software.message(),
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
