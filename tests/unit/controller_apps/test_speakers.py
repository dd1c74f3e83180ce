"""Connections that pose as a switch."""

import os
import socket
from dataclasses import dataclass
from pathlib import Path

import pytest

from controller_apps.openflow.speakers import NOBODY, Speakers, owner, owner_of

DEAD, HERE, Q1 = "dead", "main", 0x1001


@dataclass(eq=False)
class Connection:
    """What the frameworks know of one."""

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


def test_the_kernels_table_is_read_by_local_address() -> None:
    # proc(5), from a machine with 127.0.0.1:16653 of user 1000 and 10.0.0.2:5201 of user 33.
    table = (
        "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n"
        "   0: 0100007F:410D 0100007F:19FD 01 00000000:00000000 00:00000000 00000000  1000 0 1 1\n"
        "   1: 0200000A:1451 00000000:0000 0A 00000000:00000000 00:00000000 00000000    33 0 2 1\n"
    )
    assert owner_of("127.0.0.1", 16653, table) == 1000
    assert owner_of("10.0.0.2", 5201, table) == 33
    assert owner_of("127.0.0.1", 6653, table) == NOBODY
    assert Path("/proc/net/tcp").read_text().split()[:3] == table.split()[:3]
