"""Quantum events at a host, told to an application there.

The stack asks with the host's own token, so an application sees its node and no other. Nothing is
kept here: while the application does not read, the dispatcher keeps events, and counts those that
it drops.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any

from hosts.middleware.session.errors import SessionError
from wire.metadata import Reason
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
