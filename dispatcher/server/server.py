"""Starts the service on its sockets and stops it."""

import asyncio
import logging
import os
import signal
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path

import grpc

from dispatcher.build import open_layer
from dispatcher.clock import clock_of
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.server.callers import Callers
from dispatcher.server.cross_connects import CrossConnects, bind
from dispatcher.server.servicer import Failed, Service
from dispatcher.timeouts import STOP_GRACE_S, STOP_TIMEOUT_S
from programs.connection_shares import grpc_options, keep_shares
from wire.config import BadConfig, DispatcherConfig
from wire.dispatcher_pb2_grpc import add_DispatcherServicer_to_server
from wire.dispatcher_service import FLOW_CONTROL, MESSAGE_LIMITS, cross_connects_socket

MAX_SOCKET_PATH_BYTES = 100

log = logging.getLogger("dispatcher")
_left: list[grpc.aio.Server] = []  # deleting one would wait for the calls that it still has


def build_service(config: DispatcherConfig, layer: PhysicalLayer, failed: Failed) -> Service:
    """Return the service for the layer; it calls `failed` with unexpected errors."""
    callers = Callers(config.tokens, layer.network.switches.keys())
    if config.metrics_fd is None:
        return Service(layer, callers, failed, config.looking)
    from dispatcher.server.metrics import MeasuredService

    return MeasuredService(layer, callers, failed, config.looking)


@asynccontextmanager
async def metrics(config: DispatcherConfig, service: Service) -> AsyncIterator[None]:
    """Tell Prometheus the service's metrics meanwhile, if it has any."""
    if config.metrics_fd is None:
        yield
        return
    from dispatcher.server.metrics import MeasuredService
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
        self._cross_connects = CrossConnects(service.change, service.callers, service.failed)
        self._paths = config.socket, cross_connects_socket(config.socket)
        self._port = _bind(self._grpc, config.listen, credentials(config))
        with _private(self._paths):
            _bind(self._grpc, f"unix:{config.socket}")
            self._listener = bind(self._paths[1])

    async def start(self) -> None:
        """Serve from now on."""
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


def build_server(config: DispatcherConfig, service: Service) -> Server:
    """Return a server for the service, bound to the configured sockets."""
    return Server(config, service)


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

    with ExitStack() as stack:
        event_log = (
            stack.enter_context(Path(config.event_log).open("a")) if config.event_log else None
        )
        layer = open_layer(config, clock_of(config.time), event_log, stack)
        service = build_service(config, layer, failed)
        server = build_server(config, service)
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
