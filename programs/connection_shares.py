"""Each peer's share of a listener's connections: none keeps others out, or takes all descriptors.

Where Python accepts (SharedListener), a connection beyond the share is closed at once; where gRPC
does, within a second (`keep_shares`). A peer is an address, or on the loopback a user.
"""

import asyncio
import errno
import logging
import os
import resource
import socket
import sys
import time
from asyncio import StreamReader, StreamWriter
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from ipaddress import IPv4Address, ip_address
from pathlib import Path
from typing import Any, NamedTuple

from programs.timeouts import FRESH_S, HANDSHAKE_TIMEOUT_S, SHARES_LOOK_S, SILENT_S

CONNECTIONS = Path("/proc/net/tcp")  # proc(5): of this network namespace
OF_MACHINE = Path("/run/qmn/machine-connections")  # the same, of the machine's, inside a run
NOBODY = -1
REST = 4.0  # behind a reading, in durations of one: the kernel needs some 10 ms


def owner(host: str, port: int) -> int:
    return LocalUsers().owner(host, port)


def users_of(connections: str) -> dict[str, int]:
    """Return the users of sockets by local address, from the kernel's table."""
    rows = map(str.split, connections.splitlines()[1:])
    return {row[1]: int(row[7]) for row in rows}


class LocalUsers:
    """The same for many sockets of one listener."""

    def __init__(self) -> None:
        self._users: dict[str, int] = {}
        self._begun_s = self._ended_s = self._next_s = -FRESH_S

    def owner(self, host: str, port: int) -> int:
        """Return the user of a socket; NOBODY if it is gone, or newer than what could be read."""
        place = f"{int.from_bytes(IPv4Address(host).packed, sys.byteorder):08X}:{port:04X}"
        now_s = time.monotonic()
        is_known = place in self._users and now_s < self._ended_s + FRESH_S
        if not is_known and now_s >= self._next_s:
            tables = [file.read_text() for file in (OF_MACHINE, CONNECTIONS) if file.exists()]
            self._users = {at: user for table in tables for at, user in users_of(table).items()}
            self._begun_s, self._ended_s = now_s, time.monotonic()
        return self._users.get(place, NOBODY)

    def rest(self) -> None:
        """Read no more for a while, as refused peers may come back at once."""
        self._next_s = self._ended_s + REST * (self._ended_s - self._begun_s)


MOST = 1024  # connections of a listener
FILES = 4  # of all files that its process may have open, it takes one in this number
PEERS = 4  # of its connections, a peer has one in this number,
MOST_OF_ONE = 128  # and no more than these
AT_ONCE = 100  # connections accepted before the process does something else
LINE_BYTES = 1 << 16  # of a stream, as asyncio's own default
STREAMS = 512  # calls of HTTP/2 that a connection has under way
ROOT = 0
NO_FILES = errno.EMFILE, errno.ENFILE

log = logging.getLogger("connections")


class Shares(NamedTuple):
    """How many connections a listener has at most."""

    all: int
    of_one: int


def shares() -> Shares:
    files, _hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST if files == resource.RLIM_INFINITY else min(MOST, files // FILES)
    return Shares(most, max(1, min(MOST_OF_ONE, most // PEERS)))


def peer_of(address: Any, users: LocalUsers) -> str:
    """Return who is at the other end: its address, or its user if it is on the loopback."""
    if not isinstance(address, tuple):
        return "this machine"  # by a Unix socket
    host, port = address[:2]
    return f"user {users.owner(host, port)}" if ip_address(host).is_loopback else str(host)


class PeerShares:
    """The open connections of a listener, by peer; root and this process's user have no bound.

    They can end this process anyway, and a large network's switches are all of one user.
    """

    def __init__(self) -> None:
        self._open: dict[int, tuple[int, str]] = {}  # inode and peer, by descriptor
        self._of: Counter[str] = Counter()
        self._refused: set[str] = set()
        self._users = LocalUsers()

    def admits(self, connection: socket.socket, address: Any) -> bool:
        peer = peer_of(address, self._users)
        if peer in (f"user {ROOT}", f"user {os.geteuid()}"):
            return True
        if not self._has_place(peer):
            self._users.rest()
            return False
        descriptor = connection.fileno()
        if descriptor in self._open:
            self._forget(descriptor)
        self._open[descriptor] = os.fstat(descriptor).st_ino, peer
        self._of[peer] += 1
        return True

    def _has_place(self, peer: str) -> bool:
        most = shares()
        if self._of[peer] >= most.of_one or len(self._open) >= most.all:
            self._forget_closed()
        if self._of[peer] < most.of_one and len(self._open) < most.all:
            self._refused.discard(peer)
            return True
        if peer not in self._refused:
            log.warning("%s has %d connections of %d: more refused", peer, self._of[peer], most.all)
            self._refused.add(peer)
        return False

    def _forget_closed(self) -> None:
        for descriptor, (inode, _peer) in list(self._open.items()):
            try:
                closed = os.fstat(descriptor).st_ino != inode
            except OSError:
                closed = True
            if closed:
                self._forget(descriptor)

    def _forget(self, descriptor: int) -> None:
        _inode, peer = self._open.pop(descriptor)
        self._of[peer] -= 1
        if not self._of[peer]:
            del self._of[peer]


class SharedListener(socket.socket):
    """A listening socket that does not wait, and closes connections beyond their peer's share."""

    def __init__(self, listener: socket.socket) -> None:
        super().__init__(fileno=listener.detach())
        self.setblocking(False)
        self._spare = os.dup(self.fileno())
        self._shares = PeerShares()

    def accept(self) -> tuple[socket.socket, Any]:
        """Return a connection and its peer's address; BlockingIOError if none comes now."""
        for _ in range(AT_ONCE):
            connection, address = self._accept_one()
            if self._shares.admits(connection, address):
                return connection, address
            connection.close()
        raise BlockingIOError(errno.EAGAIN, "more connections wait")

    def close(self) -> None:
        os.close(self._spare)
        super().close()

    def _accept_one(self) -> tuple[socket.socket, Any]:
        """Accept; refuse all that wait if this process has no descriptor left."""
        try:
            return super().accept()
        except OSError as error:
            if error.errno not in NO_FILES:
                raise
        log.warning("no descriptor is left for a connection: refused")
        os.close(self._spare)
        try:
            super().accept()[0].close()
        finally:
            self._spare = os.dup(self.fileno())
        raise BlockingIOError(errno.EAGAIN, "no descriptor is left")


class StreamServer:
    def __init__(
        self,
        handler: Callable[[StreamReader, StreamWriter], Any],
        listener: socket.socket,
        limit: int = LINE_BYTES,
        **tls: Any,
    ) -> None:
        """Serve connections to a socket that listens; `tls` is for connect_accepted_socket."""
        self._loop = asyncio.get_running_loop()
        self._handler, self._limit, self._tls = handler, limit, tls
        shared = isinstance(listener, SharedListener)
        self._listener = listener if shared else SharedListener(listener)
        self._joining: set[asyncio.Task[None]] = set()
        self._loop.add_reader(self._listener.fileno(), self._accept)

    def close(self) -> None:
        if self._listener.fileno() >= 0:
            self._loop.remove_reader(self._listener.fileno())
            self._listener.close()

    def _accept(self) -> None:
        with suppress(BlockingIOError, ConnectionAbortedError):
            for _ in range(AT_ONCE):
                connection, _address = self._listener.accept()
                task = self._loop.create_task(self._join(connection))
                self._joining.add(task)
                task.add_done_callback(self._joining.discard)

    async def _join(self, connection: socket.socket) -> None:
        reader = StreamReader(self._limit, self._loop)
        protocol = asyncio.StreamReaderProtocol(reader, self._handler, self._loop)
        try:
            await self._loop.connect_accepted_socket(lambda: protocol, connection, **self._tls)
        except OSError as error:  # of TLS, or it has gone
            log.info("a connection ended: %s", error)
            connection.close()


def grpc_options() -> list[tuple[str, int]]:
    return [
        ("grpc.max_concurrent_streams", STREAMS),
        ("grpc.max_allowed_incoming_connections", shares().all),
        ("grpc.server_handshake_timeout_ms", 1000 * HANDSHAKE_TIMEOUT_S),
        ("grpc.keepalive_time_ms", 1000 * SILENT_S),
        ("grpc.keepalive_timeout_ms", 1000 * SILENT_S),
    ]


async def keep_shares(port: int) -> None:
    """Close, each second, what gRPC has accepted at a port beyond the shares of peers."""
    while True:
        await asyncio.sleep(SHARES_LOOK_S)
        if len(os.listdir("/proc/self/fd")) > shares().of_one:
            close_excess(port)


def _duplicate(descriptor: int) -> socket.socket:
    """Return another handle of a socket; raise OSError if the descriptor is none."""
    duplicate = os.dup(descriptor)
    try:
        return socket.socket(fileno=duplicate)
    except OSError:
        os.close(duplicate)
        raise


def close_excess(port: int) -> None:
    most, of, users = shares().of_one, Counter[str](), LocalUsers()
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        with suppress(OSError), _duplicate(descriptor) as connection:
            address = connection.getpeername()
            if isinstance(address, tuple) and connection.getsockname()[1] == port:
                peer = peer_of(address, users)
                of[peer] += 1
                if of[peer] > most:
                    connection.shutdown(socket.SHUT_RDWR)
    for peer, count in of.items():
        if count > most:
            log.warning("%s has %d connections: %d closed", peer, count, count - most)
