"""The gate: the one process that writes the clock of the network.

    program --(deadline)--> gate --(clock, in a page that all read)--> programs
                                 --(notice)--> the programs whose deadline it is

The clock leaps to the earliest deadline when nothing runs. While a client asks for that, it goes
with the wall instead.
"""

import mmap
import os
import select
import socket
import time
from contextlib import suppress
from pathlib import Path

from gate.quiescence import Quiescence
from gate.timeouts import PAUSE_S
from wire.network_time import GATE, INSTANT, NEVER, PAGE, PAGE_BYTES, TAKEN, WITH_WALL

LISTEN = 1024
NS = 1_000_000_000


class Gate:
    """The clock, and the programs that wait for it."""

    def __init__(self, folder: Path, since_ns: int, quiescence: Quiescence | None = None) -> None:
        """Make the page and the socket in the folder; the clock begins at `since_ns`."""
        self.leaps = self.wrong = 0  # wrong: a program asked for an instant that had passed
        self._quiet = Quiescence() if quiescence is None else quiescence
        page = os.open(folder / PAGE, os.O_RDWR | os.O_CREAT, 0o600)
        os.ftruncate(page, PAGE_BYTES)
        self._clock = memoryview(mmap.mmap(page, PAGE_BYTES)).cast("q")
        self._sent, self._taken = self._clock[1:TAKEN], self._clock[TAKEN + 1 :]
        os.close(page)
        self._clock[0] = since_ns
        self._deadlines: dict[socket.socket, int] = {}  # of each client
        self._wall_ns = 0  # when the clock was set by the wall last; 0: it does not go with it
        self._stepped_since_ns = since_ns
        self._poller = select.epoll()
        self._clients: dict[int, socket.socket] = {}
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(str(folder / GATE))
        self._listener.listen(LISTEN)
        self._wake_reader, self._wake_writer = os.pipe()
        self._stopped = False
        for file in (self._listener.fileno(), self._wake_reader):
            self._poller.register(file, select.EPOLLIN)

    def stop(self) -> None:
        """Let `run` return; a signal handler may call it."""
        self._stopped = True
        os.write(self._wake_writer, b"\0")

    def run(self) -> None:
        """Step the clock until `stop`."""
        while not self._stopped:
            self._take(self._wait_s())
            if self._wall_ns or WITH_WALL in self._deadlines.values():
                self._go_with_wall()
            elif self._can_leap and self._is_quiet:
                self._set(min(self._deadlines.values()))
                self.leaps += 1

    @property
    def _is_quiet(self) -> bool:
        """Whether nothing runs, no message is under way, and no client has written more."""
        return bool(self._quiet) and self._sent == self._taken and not self._take(0)

    @property
    def _can_leap(self) -> bool:
        """Whether all wait, and one of them for an instant to come."""
        return self._clock[0] < min(self._deadlines.values(), default=NEVER) < NEVER

    def _wait_s(self) -> float | None:
        """Return how long to wait for clients at most; None: until one says something."""
        if self._wall_ns:
            now_ns = self._clock[0]
            to_come = [each for each in self._deadlines.values() if now_ns < each < NEVER]
            return (min(to_come) - now_ns) / NS if to_come else None
        return PAUSE_S if self._can_leap else None

    def _take(self, wait_s: float | None) -> bool:
        """Take what clients say; return whether one did."""
        events = self._poller.poll(wait_s)
        for file, _event in events:
            if file == self._listener.fileno():
                client = self._listener.accept()[0]
                self._clients[client.fileno()], self._deadlines[client] = client, NEVER
                self._poller.register(client, select.EPOLLIN)
            elif file in self._clients:
                self._hear(self._clients[file])
        return bool(events)

    def _hear(self, client: socket.socket) -> None:
        try:
            message = client.recv(INSTANT.size)
        except ConnectionError:
            message = b""
        if not message:
            self._poller.unregister(client)
            del self._clients[client.fileno()], self._deadlines[client]
            client.close()
            return
        (deadline_ns,) = INSTANT.unpack(message)
        self._deadlines[client] = deadline_ns
        if deadline_ns != WITH_WALL and deadline_ns <= self._clock[0]:
            self.wrong += self._stepped_since_ns < deadline_ns < self._clock[0]
            self._notify(client)

    def _go_with_wall(self) -> None:
        """Set the clock by the wall, as long as a client asks for it."""
        wall_ns = time.monotonic_ns()
        if self._wall_ns:
            self._set(self._clock[0] + wall_ns - self._wall_ns)
        self._wall_ns = wall_ns if WITH_WALL in self._deadlines.values() else 0
        self._stepped_since_ns = self._clock[0]

    def _set(self, now_ns: int) -> None:
        """Set the clock, and notify those whose deadline has come."""
        before_ns, self._clock[0] = self._clock[0], now_ns
        for client, deadline_ns in self._deadlines.items():
            if before_ns < deadline_ns <= now_ns:
                self._notify(client)

    def _notify(self, client: socket.socket) -> None:
        with suppress(ConnectionError):  # it has ended, which is read next
            client.send(INSTANT.pack(self._clock[0]))
