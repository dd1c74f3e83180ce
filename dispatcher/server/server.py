"""Starts the service on its sockets and stops it."""

import asyncio
import contextlib
import logging
import os
import signal
from asyncio import StreamReader, StreamWriter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from socket import AF_UNIX, socket
from typing import Any

import grpc
from google.protobuf.message import DecodeError
from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from dispatcher.build import open_layer
from dispatcher.clock import clock_of
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.refusal import Refusal
from dispatcher.server.callers import Callers
from dispatcher.server.servicer import Failed, Service
from dispatcher.server.turns import Turns
from dispatcher.timeouts import STOP_GRACE_S, STOP_TIMEOUT_S
from programs.connection_shares import grpc_options, keep_shares
from programs.metrics import SECONDS
from programs.network_timers import timers_of
from wire import dispatcher_service
from wire.config import BadConfig, DispatcherConfig
from wire.dispatcher_pb2 import CrossConnectOutcome, CrossConnectRequest
from wire.dispatcher_pb2_grpc import add_DispatcherServicer_to_server
from wire.dispatcher_service import FLOW_CONTROL, MESSAGE_LIMITS, cross_connects_socket
from wire.malformed import MalformedPacket
from wire.network_time import DISPATCHER, SteppedTime

Change = Callable[[str, str, Any], Awaitable[int]]  # called with node, kind and request


class CrossConnects:
    """Serves all agents, each on a connection of its own, one request after the other."""

    def __init__(self, change: Change, callers: Callers, failed: Failed, turns: Turns) -> None:
        """Set them by `change`; call `failed` with any error that is not a caller's."""
        self._change, self._callers, self._failed = change, callers, failed
        self._turns = turns
        self._connections: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None

    async def start(self, listener: socket) -> None:
        self._server = await asyncio.start_unix_server(self._accept, sock=listener)

    def stop(self) -> None:
        if self._server is not None:
            self._server.close()
        for connection in self._connections:
            connection.cancel()

    def _accept(self, reader: StreamReader, writer: StreamWriter) -> None:
        connection = asyncio.create_task(self._serve(reader, writer))
        self._connections.add(connection)
        connection.add_done_callback(self._connections.discard)

    async def _serve(self, reader: StreamReader, writer: StreamWriter) -> None:
        """Answer until the agent goes away or says anything else."""
        with contextlib.closing(writer):
            try:
                token = (await dispatcher_service.read(reader)).decode()
                while True:
                    request = CrossConnectRequest.FromString(await dispatcher_service.read(reader))
                    outcome = await self._outcome(token, request)
                    writer.write(dispatcher_service.encode(outcome.SerializeToString()))
                    await writer.drain()
            except (EOFError, OSError):
                return
            except (MalformedPacket, DecodeError, UnicodeDecodeError) as error:
                log.warning("a connection for cross-connects is ended: %s", error)
            except Exception as error:
                self._failed(error)
                raise

    async def _outcome(self, token: str, request: CrossConnectRequest) -> CrossConnectOutcome:
        try:
            node = self._callers.identify(token)
            self._callers.require_agent(node, request.switch, "cross-connect")
            await self._turns.turn(node)
            ready_ns = await self._change(node, "cross_connect", request)
        except Refusal as refusal:
            return CrossConnectOutcome(code=refusal.code.value[0], text=str(refusal))
        return CrossConnectOutcome(ready_ns=ready_ns)


def bind(path: str) -> socket:
    Path(path).unlink(missing_ok=True)
    listener = socket(AF_UNIX)
    listener.bind(path)
    return listener


MAX_SOCKET_PATH_BYTES = 100

log = logging.getLogger("dispatcher")
_left: list[grpc.aio.Server] = []  # deleting one would wait for the calls that it still has


def build_service(config: DispatcherConfig, layer: PhysicalLayer, failed: Failed) -> Service:
    """Return the service for the layer; it calls `failed` with unexpected errors."""
    callers = Callers(config.tokens, layer.network.switches.keys())
    if config.metrics_fd is None:
        return Service(layer, callers, failed, config.state_inspection)

    return MeasuredService(layer, callers, failed, config.state_inspection)


@asynccontextmanager
async def metrics(config: DispatcherConfig, service: Service) -> AsyncIterator[None]:
    """Tell Prometheus the service's metrics meanwhile, if it has any."""
    if config.metrics_fd is None:
        yield
        return
    from programs.metrics import inherited
    from programs.metrics_server import serve as serve_metrics

    assert isinstance(service, MeasuredService)
    endpoint = serve_metrics(inherited(config.metrics_fd), service.registry)
    try:
        yield
    finally:
        endpoint.close()


class Server:
    """gRPC for everybody, and the socket on which agents set cross-connects."""

    def __init__(self, config: DispatcherConfig, service: Service) -> None:
        """Bind the configured sockets; raise BadConfig if one cannot be had."""
        # A taken port must be an error.
        options = [*MESSAGE_LIMITS, *FLOW_CONTROL, *grpc_options(), ("grpc.so_reuseport", 0)]
        self._grpc = grpc.aio.server(options=options)
        add_DispatcherServicer_to_server(service, self._grpc)  # type: ignore[no-untyped-call]
        self._cross_connects = CrossConnects(
            service.change, service.callers, service.failed, service.turns
        )
        self._paths = config.socket, cross_connects_socket(config.socket)
        self._port = _bind(self._grpc, config.listen, credentials(config))
        with _private(self._paths):
            _bind(self._grpc, f"unix:{config.socket}")
            self._listener = bind(self._paths[1])

    async def start(self) -> None:
        await self._cross_connects.start(self._listener)
        await self._grpc.start()
        self._sharing = asyncio.create_task(keep_shares(self._port))

    async def stop(self, grace_s: float | None) -> None:
        """End all calls, after a while in which those that run may end; remove the sockets."""
        self._sharing.cancel()
        self._cross_connects.stop()
        try:
            async with asyncio.timeout((grace_s or 0) + STOP_TIMEOUT_S):
                await self._grpc.stop(grace_s)
        except TimeoutError:
            log.warning("a watcher does not read: its call is left as it is")
            _left.append(self._grpc)
        for path in self._paths:
            Path(path).unlink(missing_ok=True)


async def serve(config: DispatcherConfig) -> None:
    """Serve until a signal comes; raise what ends the service unexpectedly."""
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[None] = loop.create_future()

    def failed(error: BaseException) -> None:
        if not ended.done():
            ended.set_exception(error)

    def stop() -> None:
        if not ended.done():
            ended.set_result(None)

    if isinstance(config.time, SteppedTime):
        timers_of(loop, config.time, DISPATCHER)
    with ExitStack() as stack:
        event_log = (
            stack.enter_context(Path(config.event_log).open("a")) if config.event_log else None
        )
        layer = open_layer(config, clock_of(config.time), event_log, stack)
        service = build_service(config, layer, failed)
        server = Server(config, service)
        async with metrics(config, service):
            await server.start()
            for number in (signal.SIGTERM, signal.SIGINT):
                loop.add_signal_handler(number, stop)
            log.info("serving on %s and %s, seed %d", config.listen, config.socket, config.seed)
            print("ready", flush=True)
            try:
                await ended
            finally:
                await server.stop(STOP_GRACE_S)
    log.info("stopped after %d events", layer.history.count)


def credentials(config: DispatcherConfig) -> grpc.ServerCredentials | None:
    """Return what callers of a network see of the dispatcher in TLS, and must show; None: plain."""
    if config.credentials is None:
        return None
    try:
        authority, certificate, private_key = config.credentials.read()
    except OSError as error:
        raise BadConfig(f"the dispatcher's certificate: {error}") from error
    return grpc.ssl_server_credentials([(private_key, certificate)], authority, True)


def _bind(
    server: grpc.aio.Server, address: str, credentials: grpc.ServerCredentials | None = None
) -> int:
    try:
        if credentials is None:
            return server.add_insecure_port(address)
        return server.add_secure_port(address, credentials)
    except RuntimeError as error:
        raise BadConfig(
            f"cannot listen on {address}: is the port taken, or the address not this host's?"
        ) from error


@contextmanager
def _private(paths: Iterable[str]) -> Iterator[None]:
    """Let only the owner connect to these sockets, from the first moment on."""
    for path in paths:
        if len(os.fsencode(path)) > MAX_SOCKET_PATH_BYTES:
            raise BadConfig(
                f"socket {path} is longer than {MAX_SOCKET_PATH_BYTES} bytes; shorten it"
            )
    before = os.umask(0o177)
    try:
        yield
    finally:
        os.umask(before)


class MeasuredService(Service):
    def __init__(
        self, layer: PhysicalLayer, callers: Callers, failed: Failed, state_inspection: bool = False
    ) -> None:
        super().__init__(layer, callers, failed, state_inspection)
        self.registry = CollectorRegistry()
        self.registry.register(CurrentMetrics(self))
        self._seconds = Histogram(
            "qmn_rpc_seconds",
            "What a request takes; send and receive wait for light.",
            ["rpc"],
            buckets=SECONDS,
            registry=self.registry,
        )

    async def change(self, node: str, kind: str, request: Any) -> Any:
        with self._seconds.labels(kind).time():
            return await super().change(node, kind, request)


class CurrentMetrics(Collector):
    """Counts that the physical layer keeps anyway."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        status = self._service.status()
        yield CounterMetricFamily(
            "qmn_pairs_created", "Bell pairs that sources have made.", value=status.pairs_created
        )
        yield CounterMetricFamily(
            "qmn_photons_lost", "Photons lost on their way or in memories.", status.photons_lost
        )
        yield CounterMetricFamily("qmn_events", "Quantum events.", status.events)
        yield CounterMetricFamily(
            "qmn_events_dropped", "Events that slow watchers have lost.", self._dropped()
        )
        yield GaugeMetricFamily("qmn_live_qubits", "Qubits that are simulated.", status.live_qubits)
        yield GaugeMetricFamily(
            "qmn_live_bytes", "Memory that holds their state.", status.live_bytes
        )

    def _dropped(self) -> int:
        return self._service.layer.history.dropped
