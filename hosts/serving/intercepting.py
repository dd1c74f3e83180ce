"""An interception as an application asks for it: from its call until it closes."""

import asyncio
from collections.abc import Coroutine
from typing import Any

from hosts.hardware.qnic import HardwareError
from hosts.middleware.services.interception.interception import Interception
from hosts.middleware.session.errors import SessionError
from wire.metadata import Reason
from wire.socket_calls import Call, encode_fields


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
            raise HardwareError("nobody tells any more what arrives; is the network ending?")
        call, _payload = await coming
        if call != Call.CLOSE:
            raise SessionError(Reason.PROTOCOL, f"{call.name} while intercepting")
    finally:
        for task in (working, coming):
            task.cancel()
        await asyncio.gather(working, coming, return_exceptions=True)
    writer.write(encode_fields(Call.CLOSE, **interception.summary))
