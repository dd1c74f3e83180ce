"""The calls of applications that are not for a session: watch, intercept.

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
from wire.metadata.vocabulary import Reason
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
