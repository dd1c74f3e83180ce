"""The gRPC service: one call is look up, act, reply."""

# gRPC names the methods.
# ruff: noqa: N802

import asyncio
import functools
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, TypeVar, cast

import grpc

from dispatcher.layer.journal import CausedBy
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.operations.blocks import Operations
from dispatcher.operations.gathering import Gathering
from dispatcher.operations.heralding import Heralding
from dispatcher.operations.looking import Telling
from dispatcher.operations.measurements import Measurements
from dispatcher.operations.operation_handlers import operation_handlers
from dispatcher.operations.resending import Resending
from dispatcher.operations.splitting import Splitting
from dispatcher.operations.switching import Switching
from dispatcher.operations.transport import Transport
from dispatcher.refusal import Refusal, denied, exhausted
from dispatcher.sabot.dense import TooLarge
from dispatcher.server.callers import Callers
from dispatcher.server.orders import Orders
from dispatcher.server.recorded_requests import changes
from dispatcher.timeouts import MAX_PAUSE_S
from wire import dispatcher_pb2 as messages
from wire.dispatcher_pb2_grpc import DispatcherServicer

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
            told = dict(context.invocation_metadata() or ())
            certified = context.auth_context().get(CERTIFIED)
            node = service.callers.of_call(told, context.peer(), method.__name__, certified)
            return await method(service, request, node, context)
        except Refusal as refusal:
            await context.abort(refusal.code, str(refusal))
        except Exception as error:
            service.failed(error)
            raise

    return answer


# Operations on photons that may have waited until they were asked for.
USES = frozenset(("apply", "send", "measure", "bell_measure", "gather", "resend", "split", "sense"))


class Service(DispatcherServicer):
    """Serves the nodes, the switches' agents and the runner."""

    def __init__(
        self, layer: PhysicalLayer, callers: Callers, failed: Failed, looking: bool = False
    ) -> None:
        """Serve this layer; call `failed` with any error that is not a refusal."""
        self.looking = looking
        self.callers, self.failed = callers, failed
        self.layer = layer
        self.transport = Transport(layer, failed)
        self.switching = Switching(layer)
        self._operations = Operations(layer)
        parts = self._operations, Measurements(layer), self.transport, Gathering(layer)
        self._handlers = operation_handlers(
            layer,
            *parts,
            Resending(layer),
            Splitting(layer),
            Heralding(layer, failed),
            Telling(layer),
        )
        self._changes = changes(layer, self.switching)

    async def Challenge(
        self, _request: messages.ChallengeRequest, context: Context
    ) -> messages.ChallengeReply:
        """Give what the next call on this connection is proved with."""
        return messages.ChallengeReply(nonce=self.callers.challenges.give(context.peer()))

    @call
    async def Create(
        self, request: messages.CreateRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Make a block."""
        return await self._act(node, "create", request)

    @call
    async def Apply(
        self, request: messages.ApplyRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Apply Paulis and gates."""
        return await self._act(node, "apply", request)

    @call
    async def Send(
        self, request: messages.SendRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Launch blocks into fibres."""
        return await self._act(node, "send", request)

    @call
    async def Receive(
        self, request: messages.ReceiveRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Take a block from a port."""
        return await self._act(node, "receive", request)

    @call
    async def Measure(
        self, request: messages.MeasureRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Measure a block."""
        return await self._act(node, "measure", request)

    @call
    async def BellMeasure(
        self, request: messages.BellMeasureRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Measure two blocks in the Bell basis."""
        return await self._act(node, "bell_measure", request)

    @call
    async def Store(
        self, request: messages.StoreRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Keep a block."""
        return await self._act(node, "store", request)

    @call
    async def Discard(
        self, request: messages.DiscardRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Discard a block or a session."""
        return await self._act(node, "discard", request)

    @call
    async def Gather(
        self, request: messages.GatherRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Count photons anew, in a block of their own."""
        return await self._act(node, "gather", request)

    @call
    async def Resend(
        self, request: messages.ResendRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Measure photons and put new ones in their places."""
        return await self._act(node, "resend", request)

    @call
    async def Attempt(
        self, request: messages.AttemptRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Let qubits of a memory attempt to be heralded."""
        return await self._act(node, "attempt", request)

    @call
    async def Herald(
        self, request: messages.HeraldRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Herald pairs of two hosts."""
        return await self._act(node, "herald", request)

    @call
    async def Split(
        self, request: messages.SplitRequest, node: str, _context: Context
    ) -> messages.Feedback:
        """Count the photons of pulses, and take one out of those that have several."""
        return await self._act(node, "split", request)

    @call
    async def Perform(
        self, orders: AsyncIterator[messages.Order], node: str, context: Context
    ) -> None:
        """Do what a host orders, until it goes away."""
        self.callers.require_host(node)
        perform = functools.partial(self._perform, node)
        await Orders(perform, context.write, self.transport.settled).run(self._asked(orders))

    async def _asked(self, orders: AsyncIterator[messages.Order]) -> AsyncIterator[messages.Order]:
        """Write into each order when it came, whenever its steps are done."""
        async for order in orders:
            now_ns = self.layer.clock.now_ns()
            for step in order.steps:
                kind = step.WhichOneof("operation")
                if kind in USES:
                    getattr(step, kind).asked_ns = now_ns
            yield order

    @call
    async def Look(
        self, request: messages.LookRequest, node: str, _context: Context
    ) -> messages.LookReply:
        """Tell the state of a qubit, where that is allowed."""
        self.callers.require_host(node)
        if not self.looking:
            raise denied("no state can be looked at in this network, as in none of hardware")
        return cast(messages.LookReply, await self.change(node, "look", request))

    async def _act(self, node: str, kind: str, request: Any) -> messages.Feedback:
        if kind in USES:
            request.asked_ns = self.layer.clock.now_ns()
        return await self._perform(node, kind, request)

    async def _perform(self, node: str, kind: str, request: Any) -> messages.Feedback:
        self.callers.require_host(node)
        return cast(messages.Feedback, await self.change(node, kind, request))

    async def change(self, node: str, kind: str, request: Any) -> Any:
        """Do what a caller may ask for, and what may change something; return the answer."""
        change = self._handlers.get(kind) or self._changes[kind]
        try:
            with (
                self.layer.journal.request(node, kind, request),
                CausedBy(node, kind, request),
            ):
                return await change(node, request)
        except TooLarge as error:
            raise exhausted(str(error)) from error

    @call
    async def TunePort(
        self, request: messages.TunePortRequest, node: str, _context: Context
    ) -> messages.TunePortReply:
        """Tune a port of a switch."""
        self.callers.require_agent(node, request.switch, "tune a port of")
        return messages.TunePortReply(ready_ns=await self.change(node, "tune_port", request))

    @call
    async def SwitchStatistics(
        self, request: messages.SwitchStatisticsRequest, node: str, _context: Context
    ) -> messages.SwitchStatisticsReply:
        """Tell what a switch has counted."""
        self.callers.require_reader(node, request.switch)
        return self.switching.statistics(request.switch)

    @call
    async def WatchSwitch(
        self, request: messages.WatchSwitchRequest, node: str, context: Context
    ) -> None:
        """Tell a switch's condition whenever it changes, until the caller goes away."""
        self.callers.require_reader(node, request.switch)
        with self.switching.watching(request.switch) as conditions:
            async for condition in conditions:
                try:
                    await context.write(condition)
                except grpc.aio.InternalError:
                    return  # the watcher went away

    @call
    async def InjectFault(
        self, request: messages.InjectFaultRequest, node: str, _context: Context
    ) -> messages.InjectFaultReply:
        """Make a switch faulty, or whole again."""
        self.callers.require_runner(node, "inject faults")
        self.callers.require_known(request.switch)
        await self.change(node, "inject_fault", request)
        return messages.InjectFaultReply()

    @call
    async def AdjustFiber(
        self, request: messages.AdjustFiberRequest, node: str, _context: Context
    ) -> messages.AdjustFiberReply:
        """Change something about fibres."""
        self.callers.require_runner(node, "adjust fibres")
        fibers = await self.change(node, "adjust_fiber", request)
        return messages.AdjustFiberReply(fibers=fibers)

    @call
    async def Status(
        self, request: messages.StatusRequest, node: str, _context: Context
    ) -> messages.StatusReply:
        """Tell the runner how much there is, and which blocks a node holds if one is named."""
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
            pairs_created=self._operations.pairs_created,
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
        """Tell the runner what happens, and a node what happens there, until it goes away.

        Who wants no news is told what is remembered, and nothing else.
        """
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
