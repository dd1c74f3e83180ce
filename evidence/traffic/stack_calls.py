"""Calls on hosts' stacks from one asyncio loop, for sessions of many hosts at a time."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from wire.metadata.vocabulary import Reason
from wire.socket_calls import HEADER, Call, decode_fields, decode_header, encode, encode_fields


class Refused(ConnectionError):
    """The stack has said that a call cannot be done, and why."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


class StackCalls:
    """One connection to a stack."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    def say(self, call: Call, **fields: Any) -> None:
        self._writer.write(encode_fields(call, **fields) if fields else encode(call))

    def send(self, data: bytes) -> None:
        """Send bytes of a message."""
        self._writer.write(encode(Call.DATA, data))

    async def read(self) -> tuple[Call, dict[str, Any]]:
        """Return what the stack says next; raise Refused, or EOFError if it has gone."""
        try:
            call, length = decode_header(await self._reader.readexactly(HEADER.size))
            payload = await self._reader.readexactly(length)
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            raise EOFError("the host's stack has ended") from error
        if call == Call.DATA:
            return call, {"bytes": len(payload)}
        fields = decode_fields(payload) if payload else {}
        if call == Call.FAILED:
            raise Refused(Reason(fields["reason"]).name, str(fields["text"]))
        return call, fields

    async def ask(self, **question: Any) -> dict[str, Any]:
        self.say(Call.ASK, **question)
        _call, answer = await self.read()
        if "refused" in answer:
            raise Refused(Reason(answer["reason"]).name, str(answer["refused"]))
        return answer


@asynccontextmanager
async def calls(stack: str) -> AsyncIterator[StackCalls]:
    reader, writer = await asyncio.open_unix_connection(stack)
    try:
        yield StackCalls(reader, writer)
    finally:
        writer.close()
