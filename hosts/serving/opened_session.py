"""A session as the application that asks for it sees it: from its request until it is over."""

import asyncio
import logging
from collections.abc import Coroutine
from typing import Any

from hosts.hardware.replies import HardwareError
from hosts.middleware.session.ends import Answerer, Carrier
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.session import OpeningSession
from hosts.timeouts import ACCEPT_TIMEOUT_S, READ_TIMEOUT_S
from wire.metadata.vocabulary import Reason
from wire.socket_calls import (
    HEADER,
    MAX_PAYLOAD,
    Call,
    decode_fields,
    decode_header,
    encode,
    encode_fields,
)


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


log = logging.getLogger("applications")
Coming = asyncio.Task[tuple[Call, bytes]]  # the application's next call


async def serve_session(
    session: OpeningSession, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Do what a service does, and let the application use what it leaves.

    It hears of the end when the connection is closed, so that the controller does before whatever
    the application asks for next.
    """

    async def tell(**result: Any) -> None:
        writer.write(encode_fields(Call.RESULT, **result))
        await writer.drain()

    coming = asyncio.create_task(read_call(reader))
    over = b""
    try:
        await unless_gone(session.run(tell), coming)
        if session.carrier is not None:
            coming = await _carry(session, session.carrier, coming, reader, writer)
            await unless_gone(session.finish(), coming)
        else:
            if session.answer is not None:
                await _answer_until_closed(session, coming, reader, writer)
            await session.finish()
        over = encode_fields(Call.CLOSE, **session.summary)
    except (SessionError, HardwareError) as error:
        log.warning("%s", error)
        await session.give_up(error)
        over = failed(error, **session.summary)
    finally:
        await stopped(coming)
        await session.close()
    if not writer.is_closing():  # the application may have gone meanwhile
        writer.write(over)


async def _carry(
    session: OpeningSession,
    carrier: Carrier,
    coming: Coming,
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> Coming:
    """Send what the application gives until it closes; return its next call."""
    while True:
        writer.write(encode_fields(Call.DONE, **session.summary))
        await writer.drain()
        call, payload = await coming
        coming = asyncio.create_task(read_call(reader))
        if call == Call.CLOSE:
            return coming
        try:
            if call != Call.DATA:
                raise SessionError(Reason.PROTOCOL, f"{call.name} while sending")
            await unless_gone(carrier.send(payload), coming)
        except BaseException:
            await stopped(coming)
            raise


async def _answer_until_closed(
    session: OpeningSession,
    coming: Coming,
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> None:
    """Answer the application until it closes; raise SessionError if the other end is lost."""
    lost = asyncio.create_task(session.lost())
    try:
        writer.write(encode_fields(Call.DONE, **session.summary))
        while True:
            await asyncio.wait([lost, coming], return_when=asyncio.FIRST_COMPLETED)
            if lost.done():
                return lost.result()
            call, question = await coming
            if call == Call.CLOSE:
                return None
            if call != Call.ASK:
                raise SessionError(Reason.PROTOCOL, f"{call.name} while pairs are held")
            writer.write(await reply(session.answer, question))
            await writer.drain()
            coming = asyncio.create_task(read_call(reader))
    except (asyncio.IncompleteReadError, ConnectionError):
        return None
    finally:
        await stopped(lost)
        await stopped(coming)


async def read_call(reader: asyncio.StreamReader) -> tuple[Call, bytes]:
    """Return an application's next call; raise IncompleteReadError when it has gone."""
    call, length = decode_header(await reader.readexactly(HEADER.size))
    return call, await reader.readexactly(length)


async def unless_gone(work: Coroutine[Any, Any, None], coming: asyncio.Task[Any]) -> None:
    """Do the work; give it up if the application ends before, which its next call tells."""
    doing = asyncio.create_task(work)
    try:
        await asyncio.wait([doing, coming], return_when=asyncio.FIRST_COMPLETED)
        if not doing.done() and coming.exception() is not None:
            await coming
        await doing
    finally:
        await stopped(doing)


async def stopped(task: asyncio.Task[Any]) -> None:
    """Cancel a task unless it is done; what becomes of it matters no more."""
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def reply(answer: Answerer | None, question: bytes) -> bytes:
    """Return the message that answers a question, or says why not; a refusal ends nothing.

    Raise MalformedPacket for what is not a question.
    """
    fields = decode_fields(question)
    try:
        if answer is None:
            raise unsupported("there is nothing here to ask about, or not yet")
        return encode_fields(Call.DONE, **await answer(fields))
    except (SessionError, HardwareError) as error:
        reason = error.reason if isinstance(error, SessionError) else Reason.HARDWARE
        return encode_fields(Call.DONE, refused=str(error), reason=reason)
