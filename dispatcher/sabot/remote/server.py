"""Starts the Sabot server on a Unix socket that its owner alone can open."""

import os
import signal
import threading
from collections.abc import Iterator
from concurrent import futures
from contextlib import contextmanager
from pathlib import Path

import grpc

from dispatcher.sabot.remote.sabot_servicer import SabotService
from dispatcher.timeouts import SIMULATOR_STOP_GRACE_S, SIMULATOR_STOP_TIMEOUT_S
from wire.config import BadConfig
from wire.dispatcher_service import MESSAGE_LIMITS
from wire.sabot_pb2_grpc import add_SabotServicer_to_server

MAX_SOCKET_PATH_BYTES = 100
MAX_WAITING_CALLS = 64


@contextmanager
def serving(socket: str, max_live_qubits: int) -> Iterator[None]:
    """Serve on a socket until the block is left; raise BadConfig if that cannot be."""
    if len(os.fsencode(socket)) > MAX_SOCKET_PATH_BYTES:
        raise BadConfig(f"socket {socket} is longer than {MAX_SOCKET_PATH_BYTES} bytes; shorten it")
    # One thread: calls wait for each other, as the states need it.
    with futures.ThreadPoolExecutor(max_workers=1) as pool:
        server = grpc.server(
            pool, options=MESSAGE_LIMITS, maximum_concurrent_rpcs=MAX_WAITING_CALLS
        )
        add_SabotServicer_to_server(SabotService(max_live_qubits), server)  # type: ignore[no-untyped-call]
        _bind(server, socket)
        server.start()
        try:
            yield
        finally:
            server.stop(SIMULATOR_STOP_GRACE_S).wait(SIMULATOR_STOP_TIMEOUT_S)
            Path(socket).unlink(missing_ok=True)


def serve(socket: str, max_live_qubits: int) -> None:
    """Serve until a signal comes."""
    stopped = threading.Event()
    with serving(socket, max_live_qubits):
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda _number, _frame: stopped.set())
        print("ready", flush=True)
        stopped.wait()


def _bind(server: grpc.Server, socket: str) -> None:
    before = os.umask(0o177)
    try:
        server.add_insecure_port(f"unix:{socket}")
    except RuntimeError as error:
        raise BadConfig(
            f"cannot listen on {socket}: is it in use, or its folder missing or not yours?"
        ) from error
    finally:
        os.umask(before)
