"""Answers Prometheus on an event loop, beside what the program does there."""

import asyncio
import socket
from asyncio import StreamReader, StreamWriter
from contextlib import closing
from functools import partial

from prometheus_client import CollectorRegistry

from programs.connection_shares import StreamServer
from programs.metrics import END, MAX_HEAD_BYTES, answer
from programs.timeouts import METRICS_TIMEOUT_S


def serve(listener: socket.socket, registry: CollectorRegistry) -> StreamServer:
    """Answer on the socket from now on, until the server that is returned is closed."""
    handler = partial(_answer, registry)
    return StreamServer(handler, listener, limit=MAX_HEAD_BYTES)


async def _answer(registry: CollectorRegistry, reader: StreamReader, writer: StreamWriter) -> None:
    """Answer one request; who is slow, or goes away, gets nothing."""
    with closing(writer):
        try:
            async with asyncio.timeout(METRICS_TIMEOUT_S):
                writer.write(answer(await _head(reader), registry))
                await writer.drain()
        except OSError:  # TimeoutError is one
            return


async def _head(reader: StreamReader) -> bytes:
    """Return a request's head, or what came instead of one."""
    try:
        return await reader.readuntil(END)
    except asyncio.IncompleteReadError as error:
        return error.partial
    except asyncio.LimitOverrunError:
        return b""
