"""Sessions that make keys, as a key manager has its host's stack hold them (wire.socket_calls)."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any

from wire.malformed import MalformedPacket
from wire.socket_calls import HEADER, Call, decode_fields, decode_header, encode_fields


class StackGone(Exception):
    """The host's stack does not answer as it should; the text says how."""


@dataclass(frozen=True)
class Outcome:
    keys: int
    qber: float | None  # of the sample, if one was disclosed
    fault: str = ""  # why there is no key; "": there is


Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@asynccontextmanager
async def _connected(stack: str) -> AsyncIterator[Streams]:
    try:
        reader, writer = await asyncio.open_unix_connection(stack)
    except OSError as error:
        raise StackGone(f"no stack answers at {stack}: {error}") from error
    try:
        yield reader, writer
    finally:
        writer.close()


async def _read(reader: asyncio.StreamReader) -> tuple[Call, dict[str, Any]]:
    try:
        call, length = decode_header(await reader.readexactly(HEADER.size))
        return call, decode_fields(await reader.readexactly(length))
    except (asyncio.IncompleteReadError, ConnectionError, MalformedPacket) as error:
        raise StackGone(f"the host's stack has ended: {error}") from error


async def _done(reader: asyncio.StreamReader) -> dict[str, Any]:
    call, fields = await _read(reader)
    if call != Call.DONE:
        raise StackGone(f"the stack answers {call.name}: {fields.get('text', '')}")
    return fields


async def _outcome(reader: asyncio.StreamReader) -> Outcome:
    qber = None
    while True:
        call, fields = await _read(reader)
        value = fields.get("qber")
        qber = value if isinstance(value, float) else qber
        if call == Call.CLOSE:
            return Outcome(int(fields["keys"]), qber)
        if call == Call.FAILED:
            return Outcome(0, qber, str(fields["text"]))


async def hold(stack: str, protocol: str, host: str, port: int, options: dict[str, Any]) -> Outcome:
    """Open a session with a host, and return what it came to; StackGone if nobody knows."""
    async with _connected(stack) as (reader, writer):
        request = encode_fields(Call.REQUEST, service=protocol, host=host, port=port, **options)
        writer.write(request)
        return await _outcome(reader)


@asynccontextmanager
async def listening(stack: str, protocol: str, port: int) -> AsyncIterator[None]:
    """Let other hosts open sessions meanwhile; StackGone if they cannot."""
    async with _connected(stack) as (reader, writer):
        writer.write(encode_fields(Call.LISTEN, port=port, service=protocol))
        await _done(reader)
        yield


async def offered(stack: str, port: int) -> AsyncIterator[tuple[str, "asyncio.Task[Outcome]"]]:
    """Yield each session that another host opens: its address, and what it will have come to."""
    going: set[asyncio.Task[Outcome]] = set()
    try:
        while True:
            peer, session = await _accepted(stack, port)
            going.add(session)
            session.add_done_callback(going.discard)
            yield peer, session
    finally:
        for each in going:
            each.cancel()


async def _accepted(stack: str, port: int) -> tuple[str, "asyncio.Task[Outcome]"]:
    async with AsyncExitStack() as until_here:
        reader, writer = await until_here.enter_async_context(_connected(stack))
        writer.write(encode_fields(Call.ACCEPT, port=port))
        peer = str((await _done(reader))["peer"])
        connection = until_here.pop_all()

    async def follow() -> Outcome:
        async with connection:
            return await _outcome(reader)

    return peer, asyncio.create_task(follow())
