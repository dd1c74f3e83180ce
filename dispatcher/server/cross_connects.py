"""The socket on which quantum-switch agents set cross-connects; see wire/dispatcher.proto."""

import asyncio
import contextlib
import logging
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable
from pathlib import Path
from socket import AF_UNIX, socket
from typing import Any

from google.protobuf.message import DecodeError

from dispatcher.refusal import Refusal
from dispatcher.server.callers import Callers
from dispatcher.server.servicer import Failed
from wire import frames
from wire.dispatcher_pb2 import CrossConnectOutcome, CrossConnectRequest
from wire.malformed import MalformedPacket

Change = Callable[[str, str, Any], Awaitable[int]]  # called with node, kind and request

log = logging.getLogger("dispatcher")


class CrossConnects:
    """Serves all agents, each on a connection of its own, one request after the other."""

    def __init__(self, change: Change, callers: Callers, failed: Failed) -> None:
        """Set them by `change`; call `failed` with any error that is not a caller's."""
        self._change, self._callers, self._failed = change, callers, failed
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
                token = (await frames.read(reader)).decode()
                while True:
                    request = CrossConnectRequest.FromString(await frames.read(reader))
                    outcome = await self._outcome(token, request)
                    writer.write(frames.encode(outcome.SerializeToString()))
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
            ready_ns = await self._change(node, "cross_connect", request)
        except Refusal as refusal:
            return CrossConnectOutcome(code=refusal.code.value[0], text=str(refusal))
        return CrossConnectOutcome(ready_ns=ready_ns)


def bind(path: str) -> socket:
    Path(path).unlink(missing_ok=True)
    listener = socket(AF_UNIX)
    listener.bind(path)
    return listener
