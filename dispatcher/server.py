"""Starts the service on its sockets and stops it."""

import asyncio
import logging
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TextIO

import grpc

from dispatcher.callers import Callers
from dispatcher.clock import CaptureClock, Clock
from dispatcher.event_capture import EventCapture
from dispatcher.history import History
from dispatcher.layer import PhysicalLayer
from dispatcher.network import Network
from dispatcher.ownership import Ownership
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.tableau import Tableau
from dispatcher.service import Failed, Service
from wire.config import BadConfig, DispatcherConfig
from wire.dispatcher_pb2_grpc import add_DispatcherServicer_to_server
from wire.service import MESSAGE_LIMITS

MAX_SOCKET_PATH_BYTES = 100
STOP_GRACE_S = 0.2

log = logging.getLogger("dispatcher")


def build_layer(
    config: DispatcherConfig,
    clock: Clock,
    event_log: TextIO | None,
    capture: EventCapture | None = None,
) -> PhysicalLayer:
    """Return the physical layer that the configuration describes."""
    return PhysicalLayer(
        clock=clock,
        sabot=Sabot(Tableau),
        draws=Draws(config.seed),
        network=Network(config.fibers, config.switches),
        ownership=Ownership(),
        history=History(config.history_depth, event_log, capture),
        max_live_qubits=config.max_live_qubits,
    )


def build_service(config: DispatcherConfig, layer: PhysicalLayer, failed: Failed) -> Service:
    """Return the service for the layer; it calls `failed` with unexpected errors."""
    callers = Callers(config.tokens, layer.network.switches.keys())
    return Service(layer, callers, failed)


def build_server(config: DispatcherConfig, service: Service) -> grpc.aio.Server:
    """Return a server for the service, bound to the configured sockets."""
    server = grpc.aio.server(
        options=[
            *MESSAGE_LIMITS,
            ("grpc.so_reuseport", 0),  # a taken port must be an error
        ]
    )
    add_DispatcherServicer_to_server(service, server)  # type: ignore[no-untyped-call]
    _bind(server, config.listen)
    _bind_unix(server, config.socket)
    return server


@contextmanager
def event_capture(config: DispatcherConfig) -> Iterator[EventCapture | None]:
    """Give the capture of events that is wanted, if any."""
    if not config.event_capture:
        yield None
        return
    with Path(config.event_capture).open("wb") as file:
        yield EventCapture(file, config.fibers)


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
        capture = stack.enter_context(event_capture(config))
        layer = build_layer(config, CaptureClock(), event_log, capture)
        server = build_server(config, build_service(config, layer, failed))
        await server.start()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop)
        log.info("serving on %s and %s, seed %d", config.listen, config.socket, config.seed)
        print("ready", flush=True)
        try:
            await ended
        finally:
            await server.stop(STOP_GRACE_S)
            Path(config.socket).unlink(missing_ok=True)
    log.info("stopped after %d events", layer.history.count)


def _bind(server: grpc.aio.Server, address: str) -> None:
    try:
        server.add_insecure_port(address)
    except RuntimeError as error:
        raise BadConfig(
            f"cannot listen on {address}: is the port taken, or the address not this host's?"
        ) from error


def _bind_unix(server: grpc.aio.Server, path: str) -> None:
    if len(os.fsencode(path)) > MAX_SOCKET_PATH_BYTES:
        raise BadConfig(f"socket {path} is longer than {MAX_SOCKET_PATH_BYTES} bytes; shorten it")
    # Only the owner may connect, from the first moment on.
    before = os.umask(0o177)
    try:
        _bind(server, f"unix:{path}")
    finally:
        os.umask(before)
