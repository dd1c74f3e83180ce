"""The framework's OpenFlow listener: each peer's share of its connections."""

import errno
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest
from limits import SOON_S

from controller_apps.openflow.connection import SharedAccept
from controller_apps.openflow.framework import SwitchServer, hub
from programs import connection_shares
from programs.connection_shares import Shares

OF_ONE, ALL = 3, 5
Connect = Callable[[int], socket.socket]


@pytest.fixture
def served() -> list[Any]:
    return []


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, served: list[Any]) -> Iterator[Any]:
    """Serve with small shares; addresses of the loopback stand for hosts."""
    monkeypatch.setattr(connection_shares, "shares", lambda: Shares(ALL, OF_ONE))
    monkeypatch.setattr(connection_shares, "peer_of", lambda address, _users: address[0])
    server = SwitchServer(("127.0.0.1", 0), lambda connection, _: served.append(connection))

    def serve() -> None:
        with suppress(OSError):  # when it is shut down
            server.serve_forever()

    serving = hub.spawn(serve)
    yield server
    server.server.shutdown(socket.SHUT_RDWR)  # closing alone does not end a native accept
    hub.joinall([serving])
    for connection in served:
        connection.close()
    server.server.close()


@pytest.fixture
def connect(server: Any) -> Iterator[Connect]:
    opened: list[socket.socket] = []

    def connect(host: int) -> socket.socket:
        at = f"127.0.0.{host}", 0
        connection = socket.create_connection(server.server.getsockname(), SOON_S, at)
        connection.setblocking(False)
        opened.append(connection)
        return connection

    yield connect
    for connection in opened:
        connection.close()


def is_open(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) != b""
    except BlockingIOError:
        return True
    except ConnectionError:
        return False


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < deadline
        hub.sleep(0.01)


def test_a_peer_does_not_take_the_places_of_others(connect: Connect) -> None:
    silent = [connect(2) for _ in range(OF_ONE + 2)]
    wait_for(lambda: sum(map(is_open, silent)) == OF_ONE)
    others = [connect(3) for _ in range(ALL - OF_ONE + 1)]
    wait_for(lambda: sum(map(is_open, others)) == ALL - OF_ONE)
    assert sum(map(is_open, silent)) == OF_ONE


def test_root_has_as_many_switches_as_it_likes(
    connect: Connect, served: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_shares, "peer_of", lambda _address, _users: "user 0")
    switches = [connect(2) for _ in range(ALL + 3)]
    wait_for(lambda: len(served) == len(switches))
    assert all(map(is_open, switches))


class Exhausted:
    """A listener of a process that has no descriptor left, then one connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection, self.attempts = connection, 0

    def accept(self) -> tuple[socket.socket, object]:
        self.attempts += 1
        if self.attempts < 3:
            raise OSError(errno.EMFILE, "too many open files")
        return self.connection, ("127.0.0.2", 1)


@pytest.mark.usefixtures("server")
def test_the_listener_outlives_a_process_without_descriptors() -> None:
    slept: list[float] = []
    one, other = socket.socketpair()
    with one, other:
        listener = Exhausted(one)
        assert SharedAccept(listener, slept.append).accept()[0] is one
    assert len(slept) == 2
