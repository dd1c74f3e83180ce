"""NetQASM's classical sockets as TCP between hosts: each program listens at its host's address.

Of two programs, the one whose name comes later connects; the other waits for it.
"""

import json
import os
import select
import socket
import threading
import time
import weakref
from collections import Counter, defaultdict, deque
from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any

from netqasm.sdk.classical_communication.broadcast_channel import BroadcastChannelBySockets
from netqasm.sdk.classical_communication.message import StructuredMessage
from netqasm.sdk.classical_communication.socket import Socket as BaseSocket

from applications.netqasm.outcomes import resolved
from applications.netqasm.placement import Placement
from applications.netqasm.process_time import ready
from applications.netqasm.text_format import (
    GREETING,
    MAX_BYTES,
    TEXTS_PORT,
    Greeting,
    decode_greeting,
    encode_greeting,
    encode_text,
    take_text,
)
from applications.timeouts import GREETING_TIMEOUT_S, JOIN_TIMEOUT_S, TEXT_PAUSE_S, TEXT_TIMEOUT_S
from programs.connection_shares import NO_FILES
from wire.malformed import MalformedPacket

MOST_JOINED = 256  # connections that no socket has taken up yet


def any_ready(files: Sequence["Socket | socket.socket | int"], timeout_s: float | None) -> bool:
    """Return whether something can be read in time; unlike select, above 1,023 open files, too."""
    poll = select.poll()
    for file in files:
        poll.register(file, select.POLLIN)
    return ready(poll, timeout_s)


def counter() -> int:
    """Return the file of a count, which can be read while it is not zero."""
    return os.eventfd(0, os.EFD_NONBLOCK | os.EFD_SEMAPHORE | os.EFD_CLOEXEC)


class Exchange:
    """Where a program listens for those of others."""

    def __init__(self, role: str, address: str, peers: Collection[str]) -> None:
        """Listen from now on, until close, to programs at the addresses of the application."""
        self._role, self._peers = role, peers
        self._joined: defaultdict[tuple[str, int], deque[socket.socket]] = defaultdict(deque)
        # How many, as time-outs of files count stepped time, and those of threads do not.
        self._counts: defaultdict[tuple[str, int], int] = defaultdict(counter)
        self._changing = threading.Lock()
        self._listener = socket.create_server((address, TEXTS_PORT), backlog=64)
        threading.Thread(target=self._listen, daemon=True).start()

    def close(self) -> None:
        """Listen no more; connections that were taken up stay."""
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._changing:
            for waiting in self._joined.values():
                for connection in waiting:
                    connection.close()
            for count in self._counts.values():
                os.close(count)
            self._counts.clear()

    def wait_for(self, remote: str, number: int, timeout_s: float) -> socket.socket:
        with self._changing:
            count = self._counts[remote, number]
        deadline = time.monotonic() + timeout_s
        while any_ready([count], max(deadline - time.monotonic(), 0)):
            with suppress(BlockingIOError), self._changing:  # another thread was faster
                os.eventfd_read(count)
                return self._joined[remote, number].popleft()
        raise TimeoutError(f"{remote} did not open socket {number} in {timeout_s:g} s")

    def _listen(self) -> None:
        while True:
            try:
                connection, (host, _port) = self._listener.accept()
            except OSError as error:
                if error.errno not in NO_FILES:
                    return  # closed
                time.sleep(TEXT_PAUSE_S)
                continue
            if host in self._peers:
                self._greet(connection)  # one by one: in the order in which they have come
            else:
                connection.close()

    def _greet(self, connection: socket.socket) -> None:
        """Take in a connection whose greeting is right; close any other."""
        connection.settimeout(GREETING_TIMEOUT_S)
        try:
            if not any_ready([connection], GREETING_TIMEOUT_S):
                raise TimeoutError("no greeting")
            data = b""
            while part := connection.recv(GREETING.size - len(data)):
                data += part
            greeting = decode_greeting(data)
        except (OSError, MalformedPacket):
            connection.close()
            return
        with self._changing:
            full = sum(map(len, self._joined.values())) >= MOST_JOINED
            if greeting.receiver != self._role or full:
                connection.close()
                return
            self._joined[greeting.sender, greeting.socket].append(connection)
            os.eventfd_write(self._counts[greeting.sender, greeting.socket], 1)


class Socket(BaseSocket):
    """A way for texts between two programs of an application."""

    placement: Placement  # these two are set where the class is installed
    exchanges: dict[str, Exchange]

    def __init__(
        self,
        app_name: str,
        remote_app_name: str,
        socket_id: int = 0,
        timeout: float | None = None,
        use_callbacks: bool = False,
        log_config: Any = None,
    ) -> None:
        """Connect to the same socket of the other program, or raise TimeoutError."""
        self.app_name, self.remote_app_name, self.id = app_name, remote_app_name, socket_id
        self._coming, self._ended = bytearray(), False
        limit_s = JOIN_TIMEOUT_S if timeout is None else timeout
        exchange = self.exchanges[self.placement.known(app_name)]
        if self.placement.known(remote_app_name) > app_name:
            self._socket = exchange.wait_for(remote_app_name, socket_id, limit_s)
        else:
            self._socket = self._connect(limit_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(None)
        weakref.finalize(self, self._socket.close)  # no program closes it
        if use_callbacks:
            threading.Thread(target=self._call_back, daemon=True).start()

    def send(self, msg: str) -> None:
        self._socket.sendall(encode_text(msg))

    def recv(
        self, block: bool = True, timeout: float | None = None, maxsize: int | None = None
    ) -> str:
        """Return the next text.

        Raise RuntimeError if there is none and it is not to be waited for, TimeoutError if none
        comes in time, ConnectionError if the other program has ended.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            text = take_text(self._coming)
            if text is not None:
                return text
            if self._ended:
                raise ConnectionError(f"{self.remote_app_name} has closed socket {self.id}")
            left_s = None if deadline is None else max(deadline - time.monotonic(), 0)
            if not self._ready(left_s if block else 0):
                if block:
                    raise TimeoutError(f"no text from {self.remote_app_name} in {timeout:g} s")
                raise RuntimeError(f"no text from {self.remote_app_name} yet")
            self._coming += (data := self._socket.recv(MAX_BYTES))
            self._ended = not data

    def send_structured(self, msg: StructuredMessage) -> None:
        """Send a header and its payload, which JSON must be able to hold."""
        self.send(json.dumps(resolved({"header": msg.header, "payload": msg.payload})))

    def recv_structured(
        self, block: bool = True, timeout: float | None = None, maxsize: int | None = None
    ) -> StructuredMessage:
        fields = json.loads(self.recv(block, timeout, maxsize))
        return StructuredMessage(fields["header"], fields["payload"])

    def send_silent(self, msg: str) -> None:
        """Send a text; we log none."""
        self.send(msg)

    def recv_silent(
        self, block: bool = True, timeout: float | None = None, maxsize: int | None = None
    ) -> str:
        """Return the next text; we log none."""
        return self.recv(block, timeout, maxsize)

    def fileno(self) -> int:
        """Return what select can wait for."""
        return self._socket.fileno()

    def _ready(self, timeout_s: float | None) -> bool:
        return any_ready([self], timeout_s)

    def _connect(self, limit_s: float) -> socket.socket:
        """Connect to a program that may not have begun yet."""
        address = self.placement.addresses[self.remote_app_name], TEXTS_PORT
        source = self.placement.addresses[self.app_name], 0
        deadline = time.monotonic() + limit_s
        while True:
            try:
                connection = socket.create_connection(address, TEXT_TIMEOUT_S, source)
            except OSError as error:
                if time.monotonic() > deadline:
                    text = f"{self.remote_app_name} did not listen at {address} in {limit_s:g} s"
                    raise TimeoutError(f"{text} ({error})") from error
                time.sleep(TEXT_PAUSE_S)
            else:
                greeting = Greeting(self.app_name, self.remote_app_name, self.id)
                connection.sendall(encode_greeting(greeting))
                return connection

    def _call_back(self) -> None:
        while True:
            try:
                text = self.recv()
            except (OSError, MalformedPacket):
                self.conn_lost_callback()
                return
            self.recv_callback(text)


class BroadcastChannel(BroadcastChannelBySockets):
    """A way for texts to all other programs of an application."""

    def __init__(self, app_name: str, remote_app_names: list[str], **options: Any) -> None:
        super().__init__(app_name, remote_app_names, **options)
        self._heard: Counter[str] = Counter()  # texts, by program

    @property
    def _socket_class(self) -> type[Socket]:
        return Socket

    def recv(self, block: bool = True, timeout: float | None = None) -> tuple[str, str]:
        """Return who has sent the next text, and the text; raise as Socket does.

        Of roles with texts take the one that was read least: programs count texts, and
        somebody may be a round ahead. A role that has ended may have sent all its texts:
        others are waited for.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        sockets: Sequence[Socket] = list(self._sockets.values())
        while True:
            for each in sorted(sockets, key=lambda each: self._heard[each.remote_app_name]):
                try:
                    text = each.recv(block=False)
                    self._heard[each.remote_app_name] += 1
                    return each.remote_app_name, text
                except RuntimeError:
                    continue
                except ConnectionError:
                    sockets = [other for other in sockets if other is not each]
                    if not sockets:
                        raise
            if not block:
                raise RuntimeError("no text was broadcast yet")
            left_s = None if deadline is None else max(deadline - time.monotonic(), 0)
            if not any_ready(sockets, left_s):
                raise TimeoutError(f"no text was broadcast in {timeout:g} s")
