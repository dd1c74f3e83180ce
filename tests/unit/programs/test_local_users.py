"""The users of this machine behind connections by the loopback."""

import os
import socket
import time
from pathlib import Path

import pytest

from programs import connection_shares
from programs.connection_shares import NOBODY, LocalUsers, owner, users_of

# proc(5), from a machine with 127.0.0.1:16653 of user 1000 and 10.0.0.2:5201 of user 33.
TABLE = (
    "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n"
    "   0: 0100007F:410D 0100007F:19FD 01 00000000:00000000 00:00000000 00000000  1000 0 1 1\n"
    "   1: 0200000A:1451 00000000:0000 0A 00000000:00000000 00:00000000 00000000    33 0 2 1\n"
)


def test_the_kernels_table_is_read_by_local_address() -> None:
    assert users_of(TABLE) == {"0100007F:410D": 1000, "0200000A:1451": 33}
    assert Path("/proc/net/tcp").read_text().split()[:3] == TABLE.split()[:3]


def test_users_of_the_machine_are_known_inside_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_machine = tmp_path / "machine-connections"
    of_machine.write_text(TABLE)
    monkeypatch.setattr(connection_shares, "OF_MACHINE", of_machine)
    assert owner("127.0.0.1", 16653) == 1000
    assert owner("10.0.0.2", 5201) == 33
    assert owner("127.0.0.1", 6653) == NOBODY
    with socket.create_server(("127.0.0.1", 0)) as ours:
        assert owner(*ours.getsockname()) == os.geteuid()


def test_a_listener_that_refuses_again_and_again_seldom_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_shares, "OF_MACHINE", tmp_path / "nothing")
    users, readings = LocalUsers(), []

    def counted(table: str) -> dict[str, int]:
        readings.append(table)
        return {}

    monkeypatch.setattr(connection_shares, "users_of", counted)
    clock = iter(range(1_000_000))  # each look at the clock takes 1 s, so does a reading
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    for port in range(100):
        assert users.owner("127.0.0.1", port) == NOBODY
        users.rest()
    assert len(readings) * (1 + connection_shares.REST) <= next(clock) + connection_shares.REST
