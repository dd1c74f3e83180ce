"""The agent's connection to the dispatcher for cross-connects; see wire/dispatcher.proto."""

import asyncio
from asyncio import StreamReader, StreamWriter

from google.protobuf.message import DecodeError

from wire import frames
from wire.dispatcher_pb2 import CrossConnectOutcome, CrossConnectRequest
from wire.dispatcher_service import cross_connects_socket
from wire.malformed import MalformedPacket


class DispatcherLink:
    """Requests one after the other; the caller sees to it that they do not overlap."""

    def __init__(self, dispatcher: str, token: str) -> None:
        """Name the dispatcher's own socket and the switch's token; nothing is connected yet."""
        self._path = cross_connects_socket(dispatcher)
        self._token = token
        self._idle: tuple[StreamReader, StreamWriter] | None = None  # nothing is unanswered

    async def ask(self, request: CrossConnectRequest) -> CrossConnectOutcome:
        """Return what became of a request.

        Raise OSError, EOFError or MalformedPacket if there is no dispatcher to tell. A
        connection on which that happened, or on which nobody waits any more, is left.
        """
        streams, self._idle = self._idle, None
        if streams is None or streams[0].at_eof():
            self._leave(streams)
            streams = await self._connect()
        reader, writer = streams
        try:
            writer.write(frames.encode(request.SerializeToString()))
            outcome = CrossConnectOutcome.FromString(await frames.read(reader))
            self._idle = streams
        except DecodeError as error:
            raise MalformedPacket(f"no outcome of cross-connects: {error}") from error
        finally:
            if self._idle is None:
                writer.close()
        return outcome

    async def _connect(self) -> tuple[StreamReader, StreamWriter]:
        reader, writer = await asyncio.open_unix_connection(self._path)
        writer.write(frames.encode(self._token.encode()))
        return reader, writer

    def close(self) -> None:
        self._leave(self._idle)
        self._idle = None

    def _leave(self, streams: tuple[StreamReader, StreamWriter] | None) -> None:
        if streams is not None:
            streams[1].close()
