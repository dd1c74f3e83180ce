"""Software layer: a socket whose bytes travel as quantum states.

The application needs to know nothing of qubits (paper, section "Host Nodes"):

    with QuantumSocket() as quantum_socket:
        quantum_socket.connect(("bob", 7))
        quantum_socket.sendall(b"hello")
        quantum_socket.shutdown()
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hosts.service_socket import ServiceSocket
from hosts.stack_socket import BYTES, STACK_VARIABLE, QuantumSocketError, StackEnded
from wire.dispatcher_pb2 import Event
from wire.events import decode_record
from wire.socket_calls import MAX_PAYLOAD, Call, decode_fields, encode, encode_fields

__all__ = ["STACK_VARIABLE", "QuantumSocket", "QuantumSocketError", "StackEnded"]


class QuantumSocket(ServiceSocket):
    """One end of a connection over light; the end that connects sends, the other receives.

    `shutdown` tells the other end that all was sent, and waits until it has verified every byte.

    It belongs to the host whose stack listens at the given path; on a host of an emulated
    network the environment variable QMN_STACK names that path.
    """

    def __init__(self, stack: Path | str | None = None) -> None:
        super().__init__(stack)
        self._buffer = b""

    @property
    def statistics(self) -> dict[str, Any]:
        return self.summary

    def connect(self, address: tuple[str, int], **options: Any) -> None:
        """Connect to a listening application on a host.

        Options: handshake ("framed", "per-pair" or "sequential"), frame_bytes, block_pairs,
        rate_hz, fec ("none", "repetition", "hamming", "golay" or "reed-solomon"), and interleave.
        Raise QuantumSocketError with the reason if light cannot be had.
        """
        list(self.request(BYTES, address, **options))

    def sendall(self, data: bytes) -> None:
        """Send all of data; return when the other end's stack holds every byte of it."""
        for start in range(0, len(data), MAX_PAYLOAD):
            self._send(encode(Call.DATA, data[start : start + MAX_PAYLOAD]))
            self.summary = self._done()

    def recv(self, size: int) -> bytes:
        """Return up to size bytes; b"" when the sender has closed and all bytes were right."""
        while not self._buffer and not self.over:
            call, payload = self._read()
            if call == Call.CLOSE:
                self.over, self.summary = True, decode_fields(payload)
            elif call == Call.DATA:
                self._buffer = payload
            else:
                raise QuantumSocketError(f"the stack answered {call.name} to recv")
        data, self._buffer = self._buffer[:size], self._buffer[size:]
        return data

    def watch(
        self, session: int = 0, history: bool = False, follow: bool = True
    ) -> Iterator[Event]:
        """Yield what happens to qubits at this host; of one session unless it is 0.

        History: begin with what is remembered. Follow: go on with what happens, until StackEnded
        is raised because the network ends.
        """
        self._send(encode_fields(Call.WATCH, session=session, history=history, follow=follow))
        self._done()
        while True:
            call, payload = self._read()
            if call == Call.DONE:
                return
            if call != Call.EVENT:
                raise QuantumSocketError(f"the stack answered {call.name} to watch")
            yield decode_record(payload)
