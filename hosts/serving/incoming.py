"""A connection from another host, on its way to the application that will accept it."""

import asyncio
from typing import Any

from hosts.middleware.session.ends import Answerer
from hosts.middleware.session.errors import SessionError
from hosts.timeouts import ACCEPT_TIMEOUT_S, READ_TIMEOUT_S
from wire.metadata.vocabulary import Reason
from wire.socket_calls import MAX_PAYLOAD, Call, encode, encode_fields


class Incoming:
    """A connection from another host, waiting for an application and then feeding it."""

    def __init__(self, peer: str) -> None:
        self.peer = peer
        self._accepted: asyncio.Future[asyncio.StreamWriter] = (
            asyncio.get_running_loop().create_future()
        )
        self._error: BaseException | None = None
        self.ended = asyncio.Event()
        self.left = False  # the application, from what it could have asked about
        self.answer: Answerer | None = None

    def accept(self, writer: asyncio.StreamWriter) -> None:
        if self._error is not None:
            writer.write(failed(self._error))
        else:
            self._accepted.set_result(writer)

    async def deliver(self, data: bytes) -> None:
        """Pass bytes to the application; waits while it does not read."""
        writer = await self._writer()
        for start in range(0, len(data), MAX_PAYLOAD):
            await self._send(writer, encode(Call.DATA, data[start : start + MAX_PAYLOAD]))

    async def tell(self, **fields: Any) -> None:
        writer = await self._writer()
        await self._send(writer, encode_fields(Call.RESULT, **fields))

    async def ready(self, summary: dict[str, Any], answer: Answerer) -> None:
        self.answer = answer
        writer = await self._writer()
        await self._send(writer, encode_fields(Call.DONE, **summary))

    async def finish(self, statistics: dict[str, Any]) -> None:
        """Tell the application that the service is over, and all bytes that came were right."""
        writer = await self._writer()
        if not self.left:
            await self._send(writer, encode_fields(Call.CLOSE, **statistics))
        self.ended.set()

    async def fail(self, error: BaseException) -> None:
        """Tell the application, also one that accepts later, that bytes are missing."""
        self._error = error
        if self._accepted.done() and not self._accepted.result().is_closing():
            self._accepted.result().write(failed(error))
        self.ended.set()

    async def _writer(self) -> asyncio.StreamWriter:
        if self._accepted.done():
            return self._accepted.result()
        try:
            async with asyncio.timeout(ACCEPT_TIMEOUT_S):
                return await asyncio.shield(self._accepted)
        except TimeoutError as error:
            raise SessionError(
                Reason.NO_LISTENER, f"the application did not accept in {ACCEPT_TIMEOUT_S:g} s"
            ) from error

    async def _send(self, writer: asyncio.StreamWriter, message: bytes) -> None:
        """Send a message, and wait while the application does not read."""
        try:
            if writer.is_closing():  # to write then is an error of another kind
                raise ConnectionError
            async with asyncio.timeout(READ_TIMEOUT_S):
                writer.write(message)
                await writer.drain()
        except TimeoutError as error:
            text = f"the receiving application has not read for {READ_TIMEOUT_S:g} s"
            raise SessionError(Reason.NO_LISTENER, text) from error
        except ConnectionError as error:
            raise SessionError(Reason.NO_LISTENER, "the receiving application has ended") from error


def failed(error: BaseException, **statistics: int) -> bytes:
    reason = error.reason if isinstance(error, SessionError) else Reason.HARDWARE
    return encode_fields(Call.FAILED, reason=reason, text=str(error), **statistics)
