"""Connections that pose as a switch."""

import os
import socket
from dataclasses import dataclass

import pytest

from controller_apps.openflow.connection import Speakers, owner
from programs.connection_shares import NOBODY

DEAD, HERE, Q1 = "dead", "main", 0x1001


@dataclass(eq=False)
class Connection:
    """A switch as the frameworks know it."""

    address: tuple[str, int] = ("127.0.0.1", 40000)
    user: int | None = 0
    state: str = HERE
    closed: int = 0

    def close(self) -> None:
        self.state = DEAD
        self.closed += 1


def speakers() -> Speakers:
    return Speakers(DEAD, lambda connection: connection.user)


def test_the_first_speaks_for_a_switch_as_long_as_it_lasts() -> None:
    known, first, impostor, second = speakers(), Connection(), Connection(), Connection()
    assert known.admits(first, Q1)
    assert not known.admits(impostor, Q1)
    assert known.admits(first, Q1)
    assert not known.admits(impostor, Q1)
    assert (impostor.closed, first.closed) == (1, 0)
    first.state = DEAD
    assert known.admits(first, Q1)  # its end is still heard
    assert known.admits(second, Q1)
    assert not known.admits(first, Q1)


@pytest.mark.parametrize(
    ("user", "admitted"),
    [(0, True), (os.geteuid(), True), (None, True), (65534, False), (NOBODY, False)],
)
def test_no_other_local_user_is_a_switch(user: int | None, admitted: bool) -> None:
    connection = Connection(user=user)
    assert speakers().admits(connection, Q1) == admitted
    assert connection.closed == (not admitted)


def test_the_kernel_knows_whose_a_connection_is() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        with socket.create_connection(listener.getsockname()) as connection:
            assert owner(Connection(connection.getsockname())) == os.geteuid()
        assert owner(Connection(("192.0.2.1", 40000))) is None
