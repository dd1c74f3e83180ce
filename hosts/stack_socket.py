"""A program's connection to its host's stack (wire.socket_calls): what all kinds have in common."""

import os
import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from wire.metadata.vocabulary import Reason
from wire.socket_calls import HEADER, Call, decode_fields, decode_header, encode_fields

STACK_VARIABLE = "QMN_STACK"
BYTES = "sdc"  # the service that carries bytes


class QuantumSocketError(ConnectionError):
    """The connection could not be made or was lost; nothing wrong was delivered."""

    def __init__(self, text: str, reason: Reason = Reason.PROTOCOL) -> None:
        super().__init__(text)
        self.reason = reason


class StackEnded(QuantumSocketError):
    """The host's stack has ended, as it does with its network."""


class StackSocket:
    """A connection to the stack that listens at the given path.

    On a host of an emulated network the environment variable QMN_STACK names that path.
    """

    def __init__(self, stack: Path | str | None = None) -> None:
        self._stack = str(stack or os.environ.get(STACK_VARIABLE, ""))
        self._socket = self._open()
        # Its number must not go to another file while a call waits on it.
        self._receiving = threading.RLock()
        self._broken = self._closed = False
        self._listening_port = 0
        self.summary: dict[str, Any] = {}  # of the session, as far as this end has heard

    def _open(self) -> socket.socket:
        if not self._stack:
            raise QuantumSocketError(f"which host? name its stack, or set {STACK_VARIABLE}")
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(self._stack)
        except OSError as error:
            connection.close()
            raise no_stack(self._stack, error) from error
        return connection

    def settimeout(self, seconds: float | None) -> None:
        """Let every later call raise TimeoutError after this time; None waits for ever."""
        self._socket.settimeout(seconds)

    def listen(self, port: int, service: str = BYTES) -> None:
        """Let other hosts connect to this port for a service, until close."""
        self._send(encode_fields(Call.LISTEN, port=port, service=service))
        self._done()
        self._listening_port = port

    def accept(self) -> tuple[Self, str]:
        """Wait for the next connection; return its socket and the address of the peer."""
        accepted = type(self)(self._stack)
        try:
            accepted.settimeout(self._socket.gettimeout())
            accepted._send(encode_fields(Call.ACCEPT, port=self._listening_port))
            accepted.summary = accepted._done()
        except BaseException:
            accepted._socket.close()
            raise
        return accepted, accepted.summary["peer"]

    def close(self) -> None:
        """Close; without shutdown before it the other end learns that bytes may be missing.

        A call of another thread that waits on this socket ends, with QuantumSocketError.
        """
        self._closed = True
        with suppress(OSError):  # the stack may have ended before
            self._socket.shutdown(socket.SHUT_RDWR)
        with self._receiving:
            self._socket.close()

    def _done(self) -> dict[str, Any]:
        call, payload = self._read()
        if call != Call.DONE:
            raise QuantumSocketError(f"the stack answered {call.name}")
        return decode_fields(payload)

    def _read(self) -> tuple[Call, bytes]:
        """Read one message; after a time-out in the middle of one the socket is useless."""
        if self._broken:
            raise QuantumSocketError("an earlier call on this socket failed; make a new one")
        self._broken = True
        call, payload = self._read_whole()
        self._broken = False
        return call, payload

    def _read_whole(self) -> tuple[Call, bytes]:
        call, length = decode_header(self._exactly(HEADER.size))
        payload = self._exactly(length)
        if call == Call.FAILED:
            fields = decode_fields(payload)
            error = failure(fields)
            self.summary = fields or self.summary
            raise error
        return call, payload

    def _exactly(self, size: int) -> bytes:
        parts = bytearray()
        while len(parts) < size:
            part = self._receive(size - len(parts))
            if not part:
                raise self._end()
            parts += part
        return bytes(parts)

    def _receive(self, size: int) -> bytes:
        try:
            with self._receiving:
                return self._socket.recv(size)
        except OSError as error:
            if self._closed:
                raise self._end() from error
            raise

    def _send(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as error:
            if self._closed or isinstance(error, BrokenPipeError | ConnectionResetError):
                raise self._end() from error
            raise

    def _end(self) -> QuantumSocketError:
        if self._closed:
            return QuantumSocketError("this socket has been closed")
        return StackEnded("the host's stack has ended")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()


def no_stack(stack: str, error: OSError) -> QuantumSocketError:
    return QuantumSocketError(
        f"no host stack answers at {stack} ({error.strerror}); is the network up?"
    )


def failure(fields: dict[str, Any]) -> QuantumSocketError:
    """Return the error of a FAILED message; what is left in its fields is the summary."""
    return QuantumSocketError(fields.pop("text"), Reason(fields.pop("reason")))


def not_refused(answer: dict[str, Any]) -> dict[str, Any]:
    """Return an answer; raise QuantumSocketError with the reason if it is a refusal."""
    if "refused" in answer:
        raise QuantumSocketError(answer["refused"], Reason(answer["reason"]))
    return answer
