"""The stack's side of the software layer: serves the applications on this host."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from dataclasses import asdict, dataclass
from typing import Any

from hosts.active_sessions import ActiveSessions
from hosts.answering import reply
from hosts.event_watching import Watch, tell_events
from hosts.hardware.qnic import HardwareError
from hosts.incoming import Incoming, failed
from hosts.intercepting import serve_interception
from hosts.middleware.services.interception import Interception
from hosts.middleware.services.superdense.sender import SendingSession
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.options import SessionOptions
from hosts.middleware.session.session import OpeningSession
from wire.metadata import MalformedPacket, Reason
from wire.services import Role
from wire.socket_calls import (
    HEADER,
    Call,
    decode_fields,
    decode_header,
    encode_fields,
)

log = logging.getLogger("applications")

BACKLOG = 8
BYTES = "sdc"  # the service that carries bytes


@dataclass(frozen=True)
class Listening:
    """An application that waits for connections on a port."""

    service: str
    queue: "asyncio.Queue[Incoming]"
    closed: asyncio.Event


class ApplicationsPort:
    """Listening ports and connections of the applications on this host."""

    def __init__(
        self,
        connect: Callable[[SessionOptions], SendingSession],
        request: Callable[[dict[str, Any]], OpeningSession],
        watch: Watch,
        intercept: Callable[[dict[str, Any]], Interception],
        active_sessions: ActiveSessions,
    ) -> None:
        self._connect, self._request, self._watch = connect, request, watch
        self._intercept, self._active_sessions = intercept, active_sessions
        self._listening: dict[int, Listening] = {}

    def incoming(self, port: int, peer: str, service: str = BYTES) -> Incoming:
        """Queue a connection from a host for the application on a port."""
        listening = self._listening.get(port)
        if listening is None:
            raise SessionError(
                Reason.NO_LISTENER, f"no application listens on port {port}; start it first"
            )
        if listening.service != service:
            raise SessionError(
                Reason.NO_LISTENER,
                f"the application on port {port} takes part in {listening.service}, not {service}",
            )
        queue = listening.queue
        for waiting in [queue.get_nowait() for _ in range(queue.qsize())]:
            if not waiting.ended.is_set():  # those that have failed make room
                queue.put_nowait(waiting)
        if queue.full():
            raise SessionError(Reason.BUSY, f"the application on port {port} does not accept")
        connection = Incoming(peer)
        queue.put_nowait(connection)
        return connection

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one application's socket."""
        try:
            call, payload = await _read(reader)
            handlers = {
                Call.CONNECT: self._serve_sender,
                Call.REQUEST: self._serve_requester,
                Call.LISTEN: self._serve_listener,
                Call.ACCEPT: self._serve_receiver,
                Call.WATCH: self._serve_watcher,
                Call.INTERCEPT: self._serve_interceptor,
            }
            if call not in handlers:
                raise SessionError(Reason.PROTOCOL, f"{call.name} on a socket that is not open")
            await handlers[call](decode_fields(payload), reader, writer)
        except (SessionError, HardwareError, MalformedPacket) as error:
            log.warning("%s", error)
            writer.write(failed(error))
        except (asyncio.IncompleteReadError, ConnectionError):
            log.info("an application closed its socket")
        finally:
            writer.close()

    async def _serve_sender(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        session = self._connect(SessionOptions.from_fields(fields))
        with self._active_sessions.engage(session.setup.session, Role.OPENER):
            await self._send(session, reader, writer)

    async def _send(
        self, session: SendingSession, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        coming = asyncio.create_task(_read(reader))
        try:
            await _unless_gone(session.open(), coming)
            while True:
                writer.write(encode_fields(Call.DONE, **asdict(session.statistics)))
                await writer.drain()
                call, payload = await coming
                coming = asyncio.create_task(_read(reader))
                if call == Call.CLOSE:
                    await _unless_gone(session.finish(), coming)
                    writer.write(encode_fields(Call.DONE, **asdict(session.statistics)))
                    return
                if call != Call.DATA:
                    raise SessionError(Reason.PROTOCOL, f"{call.name} while sending")
                await _unless_gone(session.send(payload), coming)
        except (SessionError, HardwareError) as error:
            log.warning("%s", error)
            await session.give_up(error)
            writer.write(failed(error, **asdict(session.statistics)))
        finally:
            await _end(coming)
            await session.close()

    async def _serve_requester(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        session = self._request(fields)
        with self._active_sessions.engage(session.setup.session, Role.OPENER):
            await _take_part(session, reader, writer)

    async def _serve_watcher(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        watching = tell_events(self._watch, fields, writer)
        coming = asyncio.create_task(_read(reader))
        try:
            await _unless_gone(watching, coming)
        finally:
            await _end(coming)

    async def _serve_interceptor(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        await serve_interception(self._intercept(fields), _read(reader), writer)

    async def _serve_listener(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        port = _port(fields)
        if port in self._listening:
            raise SessionError(Reason.BUSY, f"port {port} is taken by another application")
        service = fields.get("service", BYTES)
        self._listening[port] = Listening(service, asyncio.Queue(BACKLOG), asyncio.Event())
        try:
            writer.write(encode_fields(Call.DONE))
            await _closed(reader)
        finally:
            self._listening.pop(port).closed.set()

    async def _serve_receiver(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        port = _port(fields)
        if port not in self._listening:
            raise SessionError(Reason.NO_LISTENER, f"accept on port {port}, which does not listen")
        listening = self._listening[port]
        gone = asyncio.create_task(_closed(reader))
        arrival = asyncio.create_task(listening.queue.get())
        closed = asyncio.create_task(listening.closed.wait())
        await asyncio.wait([gone, arrival, closed], return_when=asyncio.FIRST_COMPLETED)
        await _end(closed)
        if not arrival.done():
            await asyncio.gather(_end(gone), _end(arrival))
            text = f"the socket that listens on port {port} has been closed"
            raise SessionError(Reason.NO_LISTENER, text)
        connection = arrival.result()
        writer.write(encode_fields(Call.DONE, peer=connection.peer))
        await _end(gone)
        connection.accept(writer)
        await _listen_to(connection, reader, writer)


async def _read(reader: asyncio.StreamReader) -> tuple[Call, bytes]:
    call, length = decode_header(await reader.readexactly(HEADER.size))
    return call, await reader.readexactly(length)


async def _unless_gone(work: Coroutine[Any, Any, None], coming: asyncio.Task[Any]) -> None:
    """Do the work; give it up if the application ends before, which its next call tells."""
    doing = asyncio.create_task(work)
    try:
        await asyncio.wait([doing, coming], return_when=asyncio.FIRST_COMPLETED)
        if not doing.done() and coming.exception() is not None:
            await coming
        await doing
    finally:
        await _end(doing)


async def _take_part(
    session: OpeningSession, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Do what a service does, and let the application use what it leaves."""

    async def tell(**result: Any) -> None:
        writer.write(encode_fields(Call.RESULT, **result))
        await writer.drain()

    coming = asyncio.create_task(_read(reader))
    try:
        await _unless_gone(session.run(tell), coming)
        if session.answer is not None:
            writer.write(encode_fields(Call.DONE, **session.summary))
            await _answer_until_closed(session, coming, reader, writer)
        await session.finish()
        writer.write(encode_fields(Call.CLOSE, **session.summary))
    finally:
        await _end(coming)
        await session.close()


async def _answer_until_closed(
    session: OpeningSession,
    coming: asyncio.Task[tuple[Call, bytes]],
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> None:
    """Answer the application until it closes; raise SessionError if the other end is lost."""
    lost = asyncio.create_task(session.lost())
    try:
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
            coming = asyncio.create_task(_read(reader))
    except (asyncio.IncompleteReadError, ConnectionError):
        return None
    finally:
        await _end(lost)
        await _end(coming)


async def _listen_to(
    connection: Incoming, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Answer the application until its connection ends; what else it says is nothing to us."""
    ended = asyncio.create_task(connection.ended.wait())
    try:
        while not ended.done():
            coming = asyncio.create_task(_read(reader))
            await asyncio.wait([ended, coming], return_when=asyncio.FIRST_COMPLETED)
            if not coming.done():
                await _end(coming)
                return
            call, question = coming.result()
            if call == Call.ASK:
                writer.write(await reply(connection.answer, question))
                await writer.drain()
    except (asyncio.IncompleteReadError, ConnectionError):
        connection.left = connection.answer is not None
        await ended
    finally:
        await _end(ended)


async def _end(task: asyncio.Task[Any]) -> None:
    """Cancel a task unless it is done; what becomes of it matters no more."""
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def _closed(reader: asyncio.StreamReader) -> None:
    """Wait until the application closes its socket; what it says meanwhile is nothing to us."""
    while await reader.read(HEADER.size):
        continue


def _port(fields: dict[str, Any]) -> int:
    port = fields.get("port")
    if not isinstance(port, int) or not 0 < port < 65_536:
        raise SessionError(Reason.UNSUPPORTED, f"port {port!r}: choose 1 to 65535")
    return port
