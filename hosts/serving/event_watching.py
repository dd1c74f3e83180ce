"""Quantum events at a host, told to an application there.

The stack asks with the host's own token, so an application sees its node and no other. Nothing is
kept here: while the application does not read, the dispatcher keeps events, and counts those that
it drops.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any

from hosts.middleware.session.channel import SessionError
from wire.metadata import Reason
from wire.socket_calls import Call, encode, encode_fields

Watch = Callable[[int, bool], AsyncIterator[bytes]]


async def tell_events(watch: Watch, fields: dict[str, Any], writer: asyncio.StreamWriter) -> None:
    """Write events until they end; raise SessionError for a request that cannot be."""
    session, history = fields.get("session", 0), fields.get("history", False)
    if type(session) is not int or not 0 <= session < 1 << 64 or type(history) is not bool:
        text = f"watch session {session!r}, history {history!r}: give a number and a bool"
        raise SessionError(Reason.UNSUPPORTED, text)
    writer.write(encode_fields(Call.DONE))
    async for record in watch(session, history):
        writer.write(encode(Call.EVENT, record))
        await writer.drain()
