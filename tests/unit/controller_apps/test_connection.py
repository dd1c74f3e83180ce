"""The connection of a switch: what is read ahead, and what is sent at once."""

import socket
from collections.abc import Iterator
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

from controller_apps.openflow import framework
from controller_apps.openflow.connection import AT_ONCE, Connection

MESSAGE = bytes(range(100))


class Green:
    """A socket as eventlet has it, which counts its calls; it does not wait."""

    def __init__(self, its: socket.socket) -> None:
        self.fd, self.calls = its, 0

    def recv(self, most: int) -> bytes:
        self.calls += 1
        return self.fd.recv(most)

    def getsockname(self) -> str:
        return "the socket's own"


class Ends:
    """A switch, and the connection to it."""

    def __init__(self) -> None:
        self.switch, ours = socket.socketpair()
        ours.setblocking(False)
        self.green, self.ways_given = Green(ours), 0
        self.connection = Connection(self.green, self.give_way)

    def give_way(self) -> None:
        self.ways_given += 1


@pytest.fixture
def ends() -> Iterator[Ends]:
    both = Ends()
    yield both
    both.switch.close()
    both.green.fd.close()


def test_messages_that_came_together_are_read_by_one_call(ends: Ends) -> None:
    ends.switch.sendall(MESSAGE * 20)
    read = [ends.connection.recv(size) for _ in range(20) for size in (8, 92)]
    assert b"".join(read) == MESSAGE * 20
    assert {len(part) for part in read} == {8, 92}
    assert (ends.green.calls, ends.ways_given) == (1, 0)


def test_what_has_come_is_read_to_its_end(ends: Ends) -> None:
    ends.switch.sendall(b"abc")
    assert ends.connection.recv(8) == b"abc"
    with pytest.raises(BlockingIOError):
        ends.connection.recv(8)
    ends.switch.close()
    assert ends.connection.recv(8) == b""


def test_other_switches_have_their_turn_while_one_sends_without_end(ends: Ends) -> None:
    ends.switch.sendall(bytes(2 * AT_ONCE + 1))
    left = 2 * AT_ONCE + 1
    while left:
        left -= len(ends.connection.recv(1000))
    assert ends.ways_given == 2


def test_a_full_connection_takes_no_more_and_loses_nothing(ends: Ends) -> None:
    taken = 0
    while sent := ends.connection.send_now(MESSAGE * 100):
        taken += sent
    ends.green.fd.shutdown(socket.SHUT_WR)
    arrived = b"".join(iter(lambda: ends.switch.recv(1 << 16), b""))
    assert len(arrived) == taken
    assert ends.connection.send_now(MESSAGE) == 0  # it has failed


def test_the_rest_is_the_sockets_own(ends: Ends) -> None:
    assert ends.connection.getsockname() == "the socket's own"


def test_messages_leave_in_the_order_in_which_they_are_sent() -> None:
    """Some go at once, some wait until a switch that reads slowly has taken those before."""
    hub: Any = framework.hub
    framework.serve_quickly()
    datapaths: Any = import_module(f"{framework.NAME}.controller.controller").Datapath
    one, other = socket.socketpair()
    green, switch = (hub.eventlet.greenio.GreenSocket(its) for its in (one, other))
    datapath = SimpleNamespace(
        socket=Connection(green, lambda: hub.sleep(0)),
        send_q=hub.Queue(16),
        _send_q_sem=hub.BoundedSemaphore(16),
        state=framework.MAIN,
        address="a switch",
        _close_write=lambda: green.shutdown(socket.SHUT_WR),
    )
    hub.spawn(datapaths._send_loop, datapath)
    messages = [number.to_bytes(4, "big") * (1 + 5000 * (number % 3)) for number in range(300)]
    arrived: list[bytes] = []

    def read() -> None:
        arrived.extend(iter(lambda: switch.recv(7000), b""))

    reader = hub.spawn(read)
    for number, message in enumerate(messages):
        assert datapaths.send(datapath, message, number == len(messages) - 1)
        if number % 50 == 0:
            hub.sleep(0)
    hub.joinall([reader])
    assert b"".join(arrived) == b"".join(messages)
