"""Waits of programs without an event loop, in stepped time and by the wall."""

import select
import socket
import time
from collections.abc import Iterator

import pytest
from stepping import SINCE_NS, Stepping, stepping

from programs.network_waits import NetworkWaits
from wire.network_time import NetworkTime

HOUR_NS = 3_600 * 10**9


@pytest.fixture
def gate() -> Iterator[Stepping]:
    with stepping() as running:
        yield running


def test_an_hour_of_stepped_time_passes_to_the_nanosecond_and_takes_none_here(
    gate: Stepping,
) -> None:
    with NetworkWaits(gate.time) as waits:
        began_s = time.monotonic()
        waits.sleep(3_600)
        assert time.monotonic() - began_s < 60
        assert gate.time.now_ns() == SINCE_NS + HOUR_NS


def test_time_stands_while_somebody_holds_it_and_passes_to_where_it_may(gate: Stepping) -> None:
    with NetworkWaits(gate.time) as held, NetworkWaits(gate.time) as other:
        held.hold()
        other.pass_until(SINCE_NS + HOUR_NS)
        time.sleep(0.05)
        assert gate.time.now_ns() == SINCE_NS
        held.pass_until(SINCE_NS + 7)
        while gate.time.now_ns() == SINCE_NS:
            time.sleep(0.001)
        time.sleep(0.05)
        assert gate.time.now_ns() == SINCE_NS + 7


def test_a_file_that_is_ready_ends_a_wait_and_else_its_time_does(gate: Stepping) -> None:
    near, far = socket.socketpair()
    poll = select.poll()
    poll.register(near, select.POLLIN)
    with near, far, NetworkWaits(gate.time) as waits:
        assert not waits.ready(poll, 1.5)
        assert gate.time.now_ns() == SINCE_NS + 1_500_000_000
        far.send(b"x")
        assert waits.ready(poll, 3_600)
        assert gate.time.now_ns() == SINCE_NS + 1_500_000_000


def test_paced_waits_take_as_many_times_longer_as_the_scale_says() -> None:
    began_s = time.monotonic()
    with NetworkWaits(NetworkTime(50.0)) as waits:
        waits.sleep(0.001)
    assert time.monotonic() - began_s >= 0.05
