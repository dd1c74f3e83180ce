"""The stack's side of the software layer: serves the applications on this host.

The calls of applications that are not for a session: watch, intercept.

Events: the stack asks with the host's own token, so an application sees its node and no other.
Nothing is kept here: while the application does not read, the dispatcher keeps events, and counts
those that it drops.
"""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

from hosts.hardware.replies import HardwareError
from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.session import OpeningSession
from hosts.serving.opened_session import (
    Incoming,
    failed,
    read_call,
    reply,
    serve_session,
    stopped,
    unless_gone,
)
from hosts.serving.processing import Attending, Interception, ProcessingUnit
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason
from wire.socket_calls import HEADER, Call, decode_fields, encode, encode_fields

Watch = Callable[[int, bool, bool], AsyncIterator[bytes]]


async def tell_events(watch: Watch, fields: dict[str, Any], writer: asyncio.StreamWriter) -> None:
    """Write events until they end; raise SessionError for a request that cannot be."""
    session = fields.get("session", 0)
    history, follow = fields.get("history", False), fields.get("follow", True)
    flags = type(history) is bool and type(follow) is bool
    if type(session) is not int or not 0 <= session < 1 << 64 or not flags:
        text = f"watch session {session!r}, history {history!r}, follow {follow!r}: give a number "
        raise unsupported(f"{text}and two bools")
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


log = logging.getLogger("applications")

BACKLOG = 8


@dataclass(frozen=True)
class Listening:
    service: str
    queue: "asyncio.Queue[Incoming]"
    closed: asyncio.Event


class ApplicationsPort:
    """Listening ports and connections of the applications on this host."""

    def __init__(
        self,
        request: Callable[[dict[str, Any]], OpeningSession],
        watch: Watch,
        intercept: Callable[[dict[str, Any]], Interception],
        taking_part: Callable[[OpeningSession], AbstractContextManager[None]],
    ) -> None:
        self._request, self._taking_part = request, taking_part
        self._watch, self._intercept = watch, intercept
        self._listening: dict[int, Listening] = {}
        self._expected: dict[int, tuple[tuple[str, ...], Attending]] = {}  # by port
        self.unit: ProcessingUnit | None = None

    @contextmanager
    def expecting(
        self, port: int, services: tuple[str, ...], attending: Attending
    ) -> Iterator[None]:
        """Let a session of one of these services, to this port, reach `attending`."""
        self._expected[port] = services, attending
        try:
            yield
        finally:
            self._expected.pop(port, None)

    def incoming(self, port: int, peer: str, service: str) -> Attending:
        if port in self._expected and service in self._expected[port][0]:
            return self._expected.pop(port)[1]
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
        try:
            call, payload = await read_call(reader)
            handlers = {
                Call.REQUEST: self._serve_opener,
                Call.LISTEN: self._serve_listener,
                Call.ACCEPT: self._serve_receiver,
                Call.WATCH: self._serve_watcher,
                Call.INTERCEPT: self._serve_interceptor,
                Call.PROCESS: self._serve_processing,
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

    async def _serve_opener(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        session = self._request(fields)
        with self._taking_part(session):
            await serve_session(session, reader, writer)

    async def _serve_watcher(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        watching = tell_events(self._watch, fields, writer)
        coming = asyncio.create_task(read_call(reader))
        try:
            await unless_gone(watching, coming)
        finally:
            await stopped(coming)

    async def _serve_interceptor(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        await serve_interception(self._intercept(fields), read_call(reader), writer)

    async def _serve_processing(
        self, _fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        if self.unit is None:
            raise unsupported("this host has no processing unit: install the package applications")
        await self.unit.serve_application(reader, writer)

    async def _serve_listener(
        self, fields: dict[str, Any], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        port = _port(fields)
        if port in self._listening:
            raise SessionError(
                Reason.BUSY,
                f"port {port} is taken by another application: end that, or choose another",
            )
        service = _service(fields)
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
        await stopped(closed)
        if not arrival.done():
            await asyncio.gather(stopped(gone), stopped(arrival))
            text = f"the socket that listens on port {port} has been closed"
            raise SessionError(Reason.NO_LISTENER, text)
        connection = arrival.result()
        writer.write(encode_fields(Call.DONE, peer=connection.peer))
        await stopped(gone)
        connection.accept(writer)
        await _listen_to(connection, reader, writer)


async def _listen_to(
    connection: Incoming, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Answer the application's calls until its connection ends; ignore other input."""
    ended = asyncio.create_task(connection.ended.wait())
    try:
        while not ended.done():
            coming = asyncio.create_task(read_call(reader))
            await asyncio.wait([ended, coming], return_when=asyncio.FIRST_COMPLETED)
            if not coming.done():
                await stopped(coming)
                return
            call, question = coming.result()
            if call == Call.ASK:
                writer.write(await reply(connection.answer, question))
                await writer.drain()
    except (asyncio.IncompleteReadError, ConnectionError):
        connection.left = connection.answer is not None
        await ended
    finally:
        await stopped(ended)


async def _closed(reader: asyncio.StreamReader) -> None:
    """Wait until the application closes its socket; ignore its input."""
    while await reader.read(HEADER.size):
        continue


def _service(fields: dict[str, Any]) -> str:
    service = fields.get("service")
    if not isinstance(service, str):
        raise unsupported(f"service {service!r} is not a name")
    return service


def _port(fields: dict[str, Any]) -> int:
    port = fields.get("port")
    if not isinstance(port, int) or not 0 < port < 65_536:
        raise unsupported(f"port {port!r}: choose 1 to 65535")
    return port
