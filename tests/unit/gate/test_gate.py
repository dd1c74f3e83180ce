"""The clock of the network stands while a program runs, and leaps when none does."""

import os
import select
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from stepping import DEADLINE_S, SINCE_NS, Stepping, stands, stepping

from gate.quiescence import Task
from wire.network_time import (
    CONTROLLER,
    NEVER,
    WATCH,
    WITH_WALL,
    GateClient,
    LinkCounts,
    SteppedTime,
)

LEAPS, MANY_LEAPS = 150, 100_000
LEAP_S = 0.02  # at most, on a busy machine
# Works when a message or a deadline comes: computes, and then sends a message or waits. The sender
# counts work that begins, and the worker its end.
PARTY = """
import mmap, random, select, socket, sys, time
from wire.network_time import NEVER, GateClient, SteppedTime

folder, since, number, descriptor = sys.argv[1], *map(int, sys.argv[2:])
clock = SteppedTime(1.0, since, folder)
with open(folder + "/work", "r+b") as file:
    cells = memoryview(mmap.mmap(file.fileno(), mmap.PAGESIZE)).cast("q")
begun, over = 2 * number, 2 * number + 1
other, gate, draws = socket.socket(fileno=descriptor), GateClient(clock), random.Random(number)
due = since + 1 if number == 0 else NEVER

def work():
    global due
    until = time.perf_counter() + draws.choice([0, 0, 1e-4, 1e-3]) * draws.random()
    while time.perf_counter() < until:
        pass
    if draws.random() < 0.5:
        cells[begun] += 1
        other.sendall(bytes(100))
    else:
        due = clock.now_ns() + draws.randrange(1, 10**9)

while True:
    gate.wait_for(due)
    ready = select.select([other, gate], [], [])[0]
    if gate in ready:
        gate.take_notice()
        if due <= clock.now_ns():
            due = NEVER
            work()
    if other in ready:
        if not other.recv(100, socket.MSG_WAITALL):
            break
        work()
        cells[over] += 1
"""


@pytest.fixture
def gate() -> Iterator[Stepping]:
    with stepping() as running:
        yield running


def soon(client: GateClient) -> None:
    """Wait until the client's deadline has come."""
    assert select.select([client], [], [], DEADLINE_S)[0]
    client.take_notice()


def test_the_clock_leaps_to_the_earliest_deadline_and_no_further(gate: Stepping) -> None:
    hour, day = GateClient(gate.time), GateClient(gate.time)
    day.wait_for(SINCE_NS + 86_400 * 10**9)
    hour.wait_for(SINCE_NS + 3_600 * 10**9)
    soon(hour)
    assert gate.time.now_ns() == SINCE_NS + 3_600 * 10**9
    assert gate.time.now_s() == 3_600
    assert stands(gate.time)  # until who waited for the hour says what is next
    hour.wait_for(NEVER)
    soon(day)
    assert gate.time.now_s() == 86_400
    hour.close()
    day.close()


def test_a_program_that_ends_is_not_waited_for(gate: Stepping) -> None:
    ended, other = GateClient(gate.time), GateClient(gate.time)
    ended.wait_for(SINCE_NS)
    other.wait_for(SINCE_NS + 1)
    assert stands(gate.time)
    ended.close()
    soon(other)
    other.close()


def test_the_clock_stands_while_a_process_runs(gate: Stepping) -> None:
    with (
        GateClientOf(gate) as client,
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy,
    ):
        gate.watch(busy.pid)
        client.wait_for(SINCE_NS + 1)
        assert stands(gate.time)
        busy.kill()
        soon(client)


def test_the_gate_names_what_lets_the_clock_stand() -> None:
    with stepping(held_s=0.5) as gate, GateClientOf(gate) as client:
        LinkCounts(SteppedTime(1.0, SINCE_NS, gate.time.folder, slot=7)).sent()
        client.wait_for(SINCE_NS + 1)
        assert gate.says() == "the clock has stood for 0.5 s: 1 messages of link 7\n"
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    with stepping(held_s=0.5) as gate, busy, GateClientOf(gate) as client:
        gate.watch(busy.pid)
        client.wait_for(SINCE_NS + 1)
        text = gate.says()
        busy.kill()
    assert text.startswith(f"the clock has stood for 0.5 s: {busy.pid} (python"), text


def test_a_later_network_in_the_same_folder_has_a_clock_of_its_own() -> None:
    with TemporaryDirectory(dir="/tmp") as parent:
        folder = Path(parent, "time")
        for _network in range(2):
            folder.mkdir()
            gate = Stepping(folder)
            assert not gate.time.has_begun
            gate.time.begin()
            assert gate.time.has_begun
            gate.kill()
            shutil.rmtree(folder)


def test_the_clock_goes_on_while_a_thread_of_grpc_runs(gate: Stepping) -> None:
    named = "open('/proc/self/comm', 'w').write('event_engine'); print(flush=True)"
    command = [sys.executable, "-c", f"{named}\nwhile True: pass"]
    with (
        GateClientOf(gate) as client,
        subprocess.Popen(command, stdout=subprocess.PIPE) as carrier,
    ):
        assert carrier.stdout is not None
        carrier.stdout.readline()
        gate.watch(carrier.pid)
        client.wait_for(SINCE_NS + 1)
        soon(client)
        carrier.kill()


def test_the_clock_stands_while_a_message_is_under_way(gate: Stepping) -> None:
    near = LinkCounts(SteppedTime(1.0, SINCE_NS, gate.time.folder, slot=7))
    far = LinkCounts(gate.time, far_slot=7)
    with GateClientOf(gate) as client:
        for sender, taker in ((near, far), (far, near)):
            sender.sent()
            client.wait_for(gate.time.now_ns() + 1)
            assert stands(gate.time)
            taker.taken()
            soon(client)
        for take in (far.ended, near.answered):
            near.sent()
            take()
            client.wait_for(gate.time.now_ns() + 1)
            soon(client)


def test_what_a_killed_program_had_sent_holds_no_time_once_another_takes_its_place(
    gate: Stepping,
) -> None:
    own = SteppedTime(1.0, SINCE_NS, gate.time.folder, slot=7)
    LinkCounts(own).sent()
    LinkCounts(gate.time, far_slot=7).sent()
    with GateClientOf(gate) as client:
        client.wait_for(gate.time.now_ns() + 1)
        assert stands(gate.time)
        LinkCounts(own)
        soon(client)


def test_the_clock_goes_with_the_wall_while_a_program_asks_for_it(gate: Stepping) -> None:
    starting, client = GateClient(gate.time), GateClient(gate.time)
    began_s = time.monotonic()
    starting.wait_for(WITH_WALL)
    client.wait_for(SINCE_NS + 50_000_000)
    soon(client)
    assert 0.05 <= gate.time.now_s() <= time.monotonic() - began_s
    starting.close()
    client.wait_for(SINCE_NS + 3_600 * 10**9)
    soon(client)
    assert gate.time.now_s() == 3_600
    client.close()


def test_the_clock_never_leads_the_wall_where_people_watch() -> None:
    with stepping(watched=True) as gate, GateClientOf(gate) as client:
        client.wait_for(SINCE_NS + 3_600 * 10**9)  # of the start
        soon(client)
        began_s = time.monotonic()
        gate.time.begin()
        for number in range(1, 4):
            client.wait_for(SINCE_NS + 3_600 * 10**9 + number * 50_000_000)
            soon(client)
        assert gate.time.now_s() == 3_600.15
        assert time.monotonic() - began_s >= 0.15


def test_the_clock_does_not_leap_for_the_background(gate: Stepping) -> None:
    polling, client = GateClient(gate.time), GateClient(gate.time)
    polling.wait_for(NEVER, SINCE_NS + 5)
    assert stands(gate.time)
    client.wait_for(SINCE_NS + 10)
    soon(client)
    assert not select.select([polling], [], [], 0.05)[0]  # the network is not ready
    gate.time.begin()
    client.wait_for(SINCE_NS + 10)
    soon(polling)  # once the clock has passed it
    assert gate.time.now_ns() == SINCE_NS + 10
    assert gate.time.in_background
    polling.wait_for(NEVER, SINCE_NS + 15)
    client.wait_for(NEVER)
    assert stands(gate.time)
    polling.close()
    client.close()
    assert gate.end() == (1, 0)


def test_the_clock_stops_for_a_watch_only_on_its_way(gate: Stepping) -> None:
    watching = GateClient(gate.time, WATCH)
    watching.wait_for(SINCE_NS + 5)
    assert stands(gate.time)
    with GateClientOf(gate) as client:
        client.wait_for(SINCE_NS + 10)
        soon(watching)
        assert gate.time.now_ns() == SINCE_NS + 5
        watching.wait_for(SINCE_NS + 15)  # beyond what others wait for
        soon(client)
        client.wait_for(NEVER)
        assert gate.time.now_ns() == SINCE_NS + 10
        assert stands(gate.time)
    watching.close()


def test_whose_turn_is_later_is_notified_at_the_end_of_the_instant(gate: Stepping) -> None:
    last = GateClient(gate.time, CONTROLLER)
    with GateClientOf(gate) as first:
        for client in (last, first):
            client.wait_for(SINCE_NS + 10)
        soon(first)
        until_s = time.monotonic() + 0.05
        while time.monotonic() < until_s:  # this process runs: the instant is not over
            assert not select.select([last], [], [], 0)[0]
        soon(last)
        last.wait_for(gate.time.now_ns())  # and once more, of the same instant
        soon(last)
        assert gate.time.now_ns() == SINCE_NS + 10
        last.wait_for(NEVER)
        first.wait_for(SINCE_NS + 20)
        soon(first)
    last.close()


def test_the_background_waits_until_all_else_of_an_instant_is_done(gate: Stepping) -> None:
    gate.time.begin()
    last, polling = GateClient(gate.time, CONTROLLER), GateClient(gate.time)
    with GateClientOf(gate) as first:
        polling.wait_for(NEVER, SINCE_NS + 5)
        for client in (last, first):
            client.wait_for(SINCE_NS + 10)
        for client in (first, last):
            assert select.select([client], [], [], DEADLINE_S)[0]
            assert not client.take_notice()
            assert not select.select([polling], [], [], 0)[0]
            assert not gate.time.in_background
            client.wait_for(NEVER)
        assert select.select([polling], [], [], DEADLINE_S)[0]
        assert polling.take_notice()
        assert gate.time.in_background
    last.close()
    polling.close()


def test_a_deadline_that_has_passed_shows_a_wrong_leap(gate: Stepping) -> None:
    with GateClientOf(gate) as client:
        client.wait_for(SINCE_NS + 10)
        soon(client)
        client.wait_for(SINCE_NS + 5)
        soon(client)
    assert gate.end() == (1, 1)


@pytest.mark.timeout(2 * MANY_LEAPS * LEAP_S)
@pytest.mark.parametrize("most", [LEAPS, pytest.param(MANY_LEAPS, marks=pytest.mark.nightly)])
def test_no_leap_is_wrong_while_two_processes_exchange_messages(gate: Stepping, most: int) -> None:
    """Each piece of work begins with a message or a deadline, and is counted until it is over."""
    ends = socket.socketpair()
    with ExitStack() as parties:
        for number, end in enumerate(ends):
            words = [gate.time.folder, str(SINCE_NS), str(number), str(end.fileno())]
            party = subprocess.Popen([sys.executable, "-c", PARTY, *words], pass_fds=[end.fileno()])
            parties.enter_context(party)
            parties.callback(party.kill)
            gate.watch(party.pid)
            end.close()
        until_s = time.monotonic() + DEADLINE_S + most * LEAP_S
        while gate.time.now_ns() < SINCE_NS + most * 10**9 and time.monotonic() < until_s:
            time.sleep(0.05)
    leaps, wrong = gate.end()
    assert leaps > most
    assert not wrong
    assert sum(struct.unpack("=4q", Path(gate.time.folder, "work").read_bytes()[:32])) > most


class GateClientOf:
    """A client of the gate that is closed at the end."""

    def __init__(self, gate: Stepping) -> None:
        self._client = GateClient(gate.time)

    def __enter__(self) -> GateClient:
        return self._client

    def __exit__(self, *_error: object) -> None:
        self._client.close()


def test_a_task_that_is_closed_leaves_no_file_open() -> None:
    folder = f"/proc/self/task/{threading.get_native_id()}"
    before = os.listdir("/proc/self/fd")
    task = Task.opened(folder)
    assert len(os.listdir("/proc/self/fd")) == len(before) + 2
    task.close()
    assert os.listdir("/proc/self/fd") == before
