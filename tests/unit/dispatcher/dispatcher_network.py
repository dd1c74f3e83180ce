"""A dispatcher with real gRPC and a clock that tests set, for the tests of the service.

charlie-q0 --1 q1 3-- alice-q0      bob-q0 --4 q1 5-- bob-q1
charlie-q1 --2 q1                   alice-q9 ------- bob-q9 (without a switch)
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import ExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
from limits import SOON_S

from dispatcher.build import open_layer
from dispatcher.clock import Clock
from dispatcher.refusal import Refusal
from dispatcher.server.server import Server, build_service
from dispatcher.server.servicer import Service
from qswitch_agent.hardware.simulated import DispatcherLink
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import (
    ApplyRequest,
    BellMeasureRequest,
    BlockId,
    Connection,
    CreateRequest,
    CrossConnectOutcome,
    CrossConnectRequest,
    DiscardRequest,
    Feedback,
    InjectFaultRequest,
    Launch,
    MeasureRequest,
    Order,
    ReceiveRequest,
    SendRequest,
    StatusReply,
    StatusRequest,
    Step,
    SwitchStatisticsReply,
    SwitchStatisticsRequest,
    TunePortReply,
    TunePortRequest,
    WatchSwitchRequest,
)
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import CHANNEL_OPTIONS, cross_connects_socket, metadata

STEP = {  # by the type of a request
    type(getattr(Step(), field.name)): field.name
    for field in Step.DESCRIPTOR.oneofs_by_name["operation"].fields
}
STATUS = {status.value[0]: status for status in grpc.StatusCode}
START_NS = 1_700_000_000_000_000_000
DELAY_NS = 49  # of 10 m
FAST_HZ = 1_000_000_000


class JumpingClock:
    """A clock that jumps to whatever time is waited for."""

    def __init__(self) -> None:
        """Begin at START_NS."""
        self.time_ns = START_NS

    def now_ns(self) -> int:
        """Return the time."""
        return self.time_ns

    async def wait_until(self, time_ns: int) -> None:
        """Jump to just after the time."""
        self.time_ns = max(self.time_ns, time_ns + 1)
        await asyncio.sleep(0)


class ManualClock(JumpingClock):
    """A clock that the test moves."""

    def __init__(self) -> None:
        """Begin at START_NS, with nobody waiting."""
        super().__init__()
        self._changed = asyncio.Condition()
        self.waiting = 0

    async def wait_until(self, time_ns: int) -> None:
        """Return once the clock has been set to a time after this."""
        async with self._changed:
            self.waiting += 1
            self._changed.notify_all()
            await self._changed.wait_for(lambda: self.time_ns > time_ns)
            self.waiting -= 1

    async def waiters(self, count: int) -> None:
        """Return once a number of callers wait for the clock."""
        async with asyncio.timeout(SOON_S), self._changed:
            await self._changed.wait_for(lambda: self.waiting >= count)

    async def set(self, time_ns: int) -> None:
        """Set the clock."""
        async with self._changed:
            self.time_ns = time_ns
            self._changed.notify_all()


def block(number: int = 0, half: int = 0, session: int = 7) -> BlockId:
    """Return the name of a block."""
    return BlockId(session=session, number=number, half=half)


class Client:
    """One node's calls."""

    def __init__(self, stub: Any, token: str, socket: str = "") -> None:
        """Call with this token; set cross-connects beside this socket."""
        self.stub, self.metadata = stub, metadata(token)
        self._link = DispatcherLink(socket, token)
        self.landed: Callable[[], Awaitable[None]] | None = None

    async def call(self, method: str, request: Any) -> Any:
        """Make a call by name, within the deadline."""
        return await getattr(self.stub, method)(request, metadata=self.metadata, timeout=SOON_S)

    async def act(self, request: Any) -> Feedback:
        """Perform one request of a host; raise the status that an outcome has."""
        order = Order(number=1, steps=[Step(**{STEP[type(request)]: request})])
        call = self.stub.Perform(iter([order]), metadata=self.metadata, timeout=SOON_S)
        (outcome,) = [outcome async for outcome in call]
        if outcome.code:
            status, nothing = STATUS[outcome.code], grpc.aio.Metadata()
            raise grpc.aio.AioRpcError(status, nothing, nothing, outcome.text, None)
        (feedback,) = outcome.feedbacks
        return feedback  # type: ignore[no-any-return]

    async def create(
        self, count: int, number: int = 0, state: CreateRequest.State = CreateRequest.BELL_PAIRS
    ) -> Feedback:
        """Create block `number` of session 7."""
        request = CreateRequest(session=7, number=number, count=count, state=state)
        return await self.act(request)

    async def apply(self, name: BlockId, paulis: bytes) -> Feedback:
        """Apply Paulis."""
        return await self.act(ApplyRequest(block=name, paulis=paulis))

    async def send(
        self, *launches: tuple[BlockId, str], rate_hz: int = FAST_HZ, frequency_mhz: int = 0
    ) -> Feedback:
        """Launch blocks; where the clock jumps, until they have come or are lost."""
        ways = [Launch(block=name, port=port) for name, port in launches]
        request = SendRequest(launches=ways, rate_hz=rate_hz, frequency_mhz=frequency_mhz)
        feedback = await self.act(request)
        if self.landed is not None:
            await self.landed()
        return feedback

    async def receive(self, name: BlockId, port: str, timeout_s: float = 5) -> Feedback:
        """Receive a block."""
        request = ReceiveRequest(block=name, port=port, timeout_s=timeout_s)
        return await self.act(request)

    async def measure(
        self, name: BlockId, basis: MeasureRequest.Basis = MeasureRequest.Z
    ) -> Feedback:
        """Measure a block."""
        return await self.act(MeasureRequest(block=name, basis=basis))

    async def bell_measure(self, first: BlockId, second: BlockId) -> Feedback:
        """Bell-measure two blocks."""
        return await self.act(BellMeasureRequest(first=first, second=second))

    async def discard(self, request: DiscardRequest) -> Feedback:
        """Discard."""
        return await self.act(request)

    async def connect(self, *connections: tuple[int, int], circuit: int = 0) -> int:
        """Set the cross-connects of q1; raise Refusal if it refuses."""
        ports = [Connection(in_port=i, out_port=o, circuit=circuit) for i, o in connections]
        outcome = await self.cross_connect(CrossConnectRequest(switch="q1", connections=ports))
        if outcome.code:
            raise Refusal(STATUS[outcome.code], outcome.text)
        return int(outcome.ready_ns)

    async def cross_connect(self, request: CrossConnectRequest) -> CrossConnectOutcome:
        """Ask for cross-connects, within the deadline."""
        async with asyncio.timeout(SOON_S):
            return await self._link.ask(request)

    def close(self) -> None:
        """End the connection for cross-connects."""
        self._link.close()

    async def tune(
        self,
        port: int,
        frequency_mhz: int = 0,
        power_dbm: float | None = None,
        direction: TunePortRequest.Direction = TunePortRequest.BOTH,
    ) -> TunePortReply:
        """Tune a port of q1."""
        request = TunePortRequest(
            switch="q1",
            port=port,
            frequency_mhz=frequency_mhz,
            power_dbm=power_dbm,
            direction=direction,
        )
        reply: TunePortReply = await self.call("TunePort", request)
        return reply

    async def statistics(self) -> SwitchStatisticsReply:
        """Ask what q1 has counted."""
        request = SwitchStatisticsRequest(switch="q1")
        reply: SwitchStatisticsReply = await self.call("SwitchStatistics", request)
        return reply

    async def inject(self, **fault: Any) -> None:
        """Make q1 faulty, or whole again."""
        await self.call("InjectFault", InjectFaultRequest(switch="q1", **fault))

    def watch_switch(self) -> Any:
        """Open a stream of q1's conditions."""
        request = WatchSwitchRequest(switch="q1")
        return self.stub.WatchSwitch(request, metadata=self.metadata, timeout=SOON_S)

    async def status(self) -> StatusReply:
        """Ask for the status."""
        reply: StatusReply = await self.call("Status", StatusRequest())
        return reply


class Bench:
    """A running dispatcher and a client for each node."""

    def __init__(
        self,
        service: Service,
        stub: Any,
        config: DispatcherConfig,
        errors: list[BaseException],
    ) -> None:
        """Make the clients."""
        self.service, self.stub = service, stub
        self.layer, self.transport = service.layer, service.table.transport
        self.switching = service.table.switching
        self.errors = errors
        clients = {node: Client(stub, f"token of {node}", config.socket) for node in config.tokens}
        self.alice, self.bob, self.charlie = (clients[n] for n in ("alice", "bob", "charlie"))
        self.switch, self.runner = clients["q1"], clients["runner"]
        self.socket = cross_connects_socket(config.socket)
        self._clients = clients

    def close(self) -> None:
        """End the clients' own connections."""
        for client in self._clients.values():
            client.close()


def configuration(folder: Path, **changes: Any) -> DispatcherConfig:
    """Return the network drawn above, with changes."""
    nodes = ("alice", "bob", "charlie", "q1", "runner")
    ends = [("charlie-q0", "1"), ("charlie-q1", "2"), ("alice-q0", "3")]
    ends += [("bob-q0", "4"), ("bob-q1", "5")]
    fibers = [Fiber(FiberEnd(p.split("-")[0], p), FiberEnd("q1", n)) for p, n in ends]
    fibers.append(Fiber(FiberEnd("alice", "alice-q9"), FiberEnd("bob", "bob-q9")))
    config = DispatcherConfig(
        listen="127.0.0.1:0",
        socket=str(folder / "d.sock"),
        seed=1,
        tokens={node: f"token of {node}" for node in nodes},
        fibers=fibers,
        switches=[QuantumSwitch("q1")],
    )
    return replace(config, **changes)


def with_fibers(config: DispatcherConfig, **changes: Any) -> DispatcherConfig:
    """Return the configuration with all fibres changed."""
    return replace(config, fibers=[replace(fiber, **changes) for fiber in config.fibers])


@asynccontextmanager
async def running(config: DispatcherConfig, clock: Clock) -> AsyncIterator[Bench]:
    """Run a dispatcher; an unexpected error in it fails the test."""
    with ExitStack() as stack:
        event_log = None
        if config.event_log:
            event_log = stack.enter_context(Path(config.event_log).open("a"))
        layer = open_layer(config, clock, event_log, stack)
        errors: list[BaseException] = []
        service = build_service(config, layer, errors.append)
        server = Server(config, service)
        await server.start()
        try:
            async with grpc.aio.insecure_channel(
                f"unix:{config.socket}", CHANNEL_OPTIONS
            ) as channel:
                stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
                bench = Bench(service, stub, config, errors)
                if type(clock) is JumpingClock:
                    for client in (bench.alice, bench.bob, bench.charlie):
                        client.landed = bench.transport.landed
                yield bench
                bench.close()
        finally:
            await server.stop(1)
    assert not errors
