"""A TCP connection that carries quantum metadata messages, and what can go wrong on it."""

import asyncio
import errno
import socket
from collections.abc import Collection
from contextlib import suppress
from typing import TypeVar

from hosts.middleware.session.errors import (
    SAME_VERSION,
    SessionError,
    SilentPeer,
    unexpected,
    unsupported,
)
from hosts.middleware.session.mailbox import Mailbox, Wanted
from hosts.timeouts import (
    ANSWER_TIMEOUT_S,
    CONNECT_TIMEOUT_S,
    CONNECT_TRIES,
    IDLE_TIMEOUT_S,
    LINGER_S,
)
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import HEADER, METADATA_PORT, Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason, UnknownService
from wire.verdict import Connection

M = TypeVar("M", bound=Message)

MOST_UNDER_WAY = 1 << 15  # bytes: a switch in user space loses the end of longer bursts


class MetadataChannel:
    """Whole messages over a byte stream, all of one session; every wait has a deadline."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        address, peer = writer.get_extra_info("sockname"), writer.get_extra_info("peername")
        self.peer: str = peer[0]
        # As its opener sees it, if that is the other end.
        self.connection: Connection = (*peer[:2], *address[:2])
        self._given_up = False
        self._session: int | None = None  # as its set-up message says, from any sender
        self._mailbox: Mailbox | None = None  # where several hear at a time
        self._reading: asyncio.Event | None = None  # by one of these, for all: set when it has
        # The answer to a short message carries its acknowledgement.
        connection = writer.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 0)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MOST_UNDER_WAY)

    @classmethod
    async def connect(cls, host: str, address: str) -> "MetadataChannel":
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                channel = cls(*await _connection(address))
        except OSError as error:  # TimeoutError is one
            raise SessionError(
                Reason.NO_ANSWER,
                f"{host} ({address}) does not answer on port {METADATA_PORT} "
                f"({str(error) or f'nothing in {CONNECT_TIMEOUT_S:g} s'}); is it up?",
            ) from error
        if host != address:
            channel.peer = f"{host} ({address})"
        return channel

    def send(self, *messages: Message) -> None:
        """Write messages, in one piece; nothing more once this end has given up.

        To a peer that is gone nothing is written either: who reads next hears that.
        """
        if self._given_up or self._writer.is_closing():
            return
        for message in messages:
            if isinstance(message, Setup):
                self._session = message.session
            if self._mailbox is not None:
                self._mailbox.receive(message)
        self._writer.write(b"".join(message.encode() for message in messages))

    async def request(self, message: Message, timeout_s: float = ANSWER_TIMEOUT_S) -> Answer:
        """Send a message and wait until it is accepted; raise what the other end refuses."""
        self.send(message)
        answer = await self.receive(Answer, timeout_s, _who_is_asked(message))
        if answer.reason != Reason.OK:
            raise SessionError(Reason(answer.reason), answer.text)
        return answer

    def sort(self) -> None:
        """Let several hear at a time from now on, each what is about its block."""
        if self._mailbox is None:
            self._mailbox = Mailbox()

    async def receive(
        self, kind: type[M], timeout_s: float, asked: str = "is it", block: int | None = None
    ) -> M:
        """Wait for the next message, which must be of this kind (or a refusal).

        Where several hear at a time: the next about this block.
        """
        try:
            message = await self.next(timeout_s, block)
        except SilentPeer as error:
            text = f"no {_named(kind)} from {self.peer} in {timeout_s:g} s: {asked} still up?"
            raise SessionError(error.reason, text) from error
        if message is None:
            text = f"{self.peer} is gone: it closed the connection instead of sending "
            raise SessionError(Reason.PEER_GONE, f"{text}{_named(kind)}; ask again when it is up")
        if isinstance(message, Answer) and message.reason != Reason.OK:
            raise SessionError(Reason(message.reason), message.text)
        if not isinstance(message, kind):
            text = f"{self.peer} sent {type(message).__name__}, not {kind.__name__}; {SAME_VERSION}"
            raise SessionError(Reason.PROTOCOL, text)
        return message

    async def next(
        self,
        timeout_s: float = IDLE_TIMEOUT_S,
        block: int | None = None,
        begins: bool = False,
        apart: Collection[int] = (),
    ) -> Message | None:
        """Return the next message, None at the end of the connection.

        Where several hear at a time: the next about this block, or that begins one or is about
        none, or is about none apart.
        """
        try:
            async with asyncio.timeout(timeout_s):
                if self._mailbox is None:
                    return self._checked(await self._read())
                return await self._taken(self._mailbox, Wanted(block, begins, apart))
        except TimeoutError as error:
            text = f"{self.peer} has been silent for {timeout_s:g} s"
            raise SilentPeer(Reason.NO_ANSWER, text) from error

    async def _taken(self, mailbox: Mailbox, wanted: Wanted) -> Message | None:
        while not mailbox.has(wanted):
            if self._reading is not None:
                await self._reading.wait()  # all look then: who waits in line may have its message
                continue
            self._reading = asyncio.Event()
            try:
                mailbox.put(self._checked(await self._read()))
            finally:
                self._reading.set()
                self._reading = None
        return mailbox.take(wanted)

    def _checked(self, message: Message | None) -> Message | None:
        """Return a message of this session; raise SessionError for one of another."""
        if self._session is None and isinstance(message, Setup):
            self._session = message.session
        if message is None or self._session in (None, message.session):
            return message
        if isinstance(message, Answer) and message.session == 0 and message.reason != Reason.OK:
            return message  # of an end that could not read what it was sent
        what = f"{type(message).__name__} of session {message.session:016x}"
        text = f"{self.peer} sent {what} over a connection of session {self._session:016x}: "
        text += "was it made up, or sent again?"
        raise SessionError(Reason.PROTOCOL, text)

    async def _read(self) -> Message | None:
        header = b""
        with suppress(ConnectionError):  # what came before the connection was lost says why
            await self._writer.drain()
        try:
            header = await self._reader.readexactly(HEADER.size)
            length = message_length(header)
            assert length is not None
            return decode(header + await self._reader.readexactly(length - HEADER.size))
        except asyncio.IncompleteReadError as error:
            if not header and not error.partial:
                return None
            text = f"{self.peer} is gone: it closed the connection inside a message"
            raise SessionError(Reason.PEER_GONE, text) from error
        except UnknownService as error:
            raise unsupported(f"{self.peer} asks for an {error}") from error
        except MalformedPacket as error:
            text = f"{self.peer} sent what is not a message: {error}; {SAME_VERSION}"
            raise SessionError(Reason.PROTOCOL, text) from error
        except ConnectionError as error:
            text = f"{self.peer} is gone: {error}; ask again when it is up"
            raise SessionError(Reason.PEER_GONE, text) from error

    def close(self) -> None:
        """Close the connection once everything is written."""
        self._writer.close()

    async def end(self) -> None:
        """Close the connection when the other end has closed it, too: it has seen that it is over.

        Raise SilentPeer if it does not.
        """
        self._write_end()
        message = await self.next(ANSWER_TIMEOUT_S)
        self.close()
        if message is not None:
            raise unexpected(message, self.peer)

    def _write_end(self) -> None:
        if not self._writer.is_closing():  # uvloop would raise RuntimeError
            self._writer.write_eof()

    async def give_up(self, error: Exception) -> None:
        """Tell the other end why it ends, and close when it has heard that.

        TCP resets a connection that is closed over unread bytes, and the other end would
        never read why.
        """
        if self._given_up:
            return
        reason = error.reason if isinstance(error, SessionError) else Reason.HARDWARE
        self.send(Answer(self._session or 0, reason, str(error)))
        self._given_up = True
        with suppress(OSError):  # TimeoutError is one
            async with asyncio.timeout(LINGER_S):
                self._write_end()
                while await self._reader.read(1 << 16):
                    continue
        self.close()


async def _connection(address: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Connect; the set-up message acknowledges the handshake.

    An acknowledgement of its own would go by way of the controller, as the set-up message does.
    The reply to ARP is late if a switch has much to forward: the kernel asks three
    times, a second apart, then says that there is no way there, and is asked again.
    """
    for _again in range(CONNECT_TRIES - 1):
        try:
            return await _tried(address)
        except OSError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
    return await _tried(address)


async def _tried(address: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    connection = socket.socket()
    try:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 0)
        await asyncio.get_running_loop().sock_connect(connection, (address, METADATA_PORT))
        return await asyncio.open_connection(sock=connection)
    except BaseException:
        connection.close()
        raise


def _who_is_asked(message: Message) -> str:
    """Return the question who may not be up if nobody answers; a set-up message waits for two."""
    return "are it and the controller" if isinstance(message, Setup) else "is it"


def _named(kind: type[Message]) -> str:
    return "its next message" if kind is Message else kind.__name__
