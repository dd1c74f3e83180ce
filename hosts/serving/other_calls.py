"""The calls of applications that are not for a session: watch, intercept, use the processing unit.

Events: the stack asks with the host's own token, so an application sees its node and no other.
Nothing is kept here: while the application does not read, the dispatcher keeps events, and counts
those that it drops.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

from hosts.hardware.replies import HardwareError
from hosts.middleware.services.interception.interception import Interception
from hosts.middleware.session.errors import SessionError
from hosts.processing_unit.unit import Connection, ProcessingUnit
from hosts.serving.opened_session import read_call, reply, stopped, unless_gone
from wire.metadata.vocabulary import Reason
from wire.netqasm.messages import decode_host_message, encode_unit_message
from wire.socket_calls import Call, encode, encode_fields

Watch = Callable[[int, bool, bool], AsyncIterator[bytes]]


async def tell_events(watch: Watch, fields: dict[str, Any], writer: asyncio.StreamWriter) -> None:
    """Write events until they end; raise SessionError for a request that cannot be."""
    session = fields.get("session", 0)
    history, follow = fields.get("history", False), fields.get("follow", True)
    flags = type(history) is bool and type(follow) is bool
    if type(session) is not int or not 0 <= session < 1 << 64 or not flags:
        text = f"watch session {session!r}, history {history!r}, follow {follow!r}: give a number "
        raise SessionError(Reason.UNSUPPORTED, f"{text}and two bools")
    writer.write(encode_fields(Call.DONE))
    async for record in watch(session, history, follow):
        writer.write(encode(Call.EVENT, record))
        await writer.drain()
    if not follow:
        writer.write(encode_fields(Call.DONE))
        await writer.drain()


async def serve_interception(
    interception: Interception,
    next_call: Coroutine[Any, Any, tuple[Call, bytes]],
    writer: asyncio.StreamWriter,
) -> None:
    """Intercept until the application's next call; HardwareError if that cannot go on."""

    async def tell(**result: Any) -> None:
        writer.write(encode_fields(Call.RESULT, **result))
        await writer.drain()

    writer.write(encode_fields(Call.DONE))
    working = asyncio.create_task(interception.run(tell))
    coming = asyncio.create_task(next_call)
    try:
        await asyncio.wait([working, coming], return_when=asyncio.FIRST_COMPLETED)
        if working.done():
            working.result()
            raise HardwareError("reports of arriving light have stopped; is the network ending?")
        call, _payload = await coming
        if call != Call.CLOSE:
            raise SessionError(Reason.PROTOCOL, f"{call.name} while intercepting")
    finally:
        for task in (working, coming):
            task.cancel()
        await asyncio.gather(working, coming, return_exceptions=True)
    writer.write(encode_fields(Call.CLOSE, **vars(interception.summary)))


async def serve_processing(
    unit: ProcessingUnit, name: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Tell an application which nodes there are, then do what it says until it closes."""
    connection = unit.connect()
    coming = asyncio.create_task(read_call(reader))
    try:
        writer.write(encode_fields(Call.DONE, node=name, nodes=unit.nodes))
        while True:
            call, payload = await coming
            if call == Call.CLOSE:
                break
            if call not in (Call.DATA, Call.ASK):
                raise SessionError(Reason.PROTOCOL, f"{call.name} to a processing unit")
            coming = asyncio.create_task(read_call(reader))
            work = _handle if call == Call.DATA else _answer
            await unless_gone(work(connection, payload, writer), coming)
    finally:
        await stopped(coming)
        await connection.close()
    writer.write(encode_fields(Call.CLOSE))


async def _handle(connection: Connection, payload: bytes, writer: asyncio.StreamWriter) -> None:
    for answer in await connection.handle(decode_host_message(payload)):
        writer.write(encode(Call.DATA, encode_unit_message(answer)))
        await writer.drain()


async def _answer(connection: Connection, question: bytes, writer: asyncio.StreamWriter) -> None:
    writer.write(await reply(connection.answer, question))
    await writer.drain()
