"""Bytes passed on between two connections, until both ends are closed or one is lost."""

import asyncio
from collections.abc import Awaitable, Callable

CHUNK_BYTES = 1 << 16

Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def relay(connect: Callable[[], Awaitable[Stream]], near: Stream, begun: bytes = b"") -> None:
    """Join a connection with one that is made for it; `begun` was read from it already.

    Where none can be made, as where nothing is served yet or any more, the connection is closed.
    """
    reader, writer = near
    try:
        far_reader, far_writer = await connect()
    except OSError:
        writer.close()
        return
    far_writer.write(begun)
    try:
        await asyncio.gather(_pass_on(reader, far_writer), _pass_on(far_reader, writer))
    finally:
        writer.close()
        far_writer.close()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass bytes on, and their end; abort if nobody takes them."""
    try:
        while data := await reader.read(CHUNK_BYTES):
            writer.write(data)
            await writer.drain()
        if not writer.is_closing():
            writer.write_eof()
    except ConnectionError:
        writer.transport.abort()
