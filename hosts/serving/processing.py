"""An application of the host's processing unit, from its first message to its last."""

import asyncio

from hosts.middleware.session.errors import SessionError
from hosts.processing_unit.unit import Connection, ProcessingUnit
from hosts.serving.answering import reply
from hosts.serving.opened_session import read_call, stopped, unless_gone
from wire.metadata import Reason
from wire.netqasm.messages import decode_host_message, encode_unit_message
from wire.socket_calls import Call, encode, encode_fields


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
