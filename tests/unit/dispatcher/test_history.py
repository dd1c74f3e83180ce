"""Events: the log, the watchers, and that a seed gives the same log again."""

import asyncio
import errno
import io
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import pytest
import uvloop
from dispatcher_network import (
    START_NS,
    Bench,
    JumpingClock,
    block,
    configuration,
    running,
    with_fibers,
)
from limits import SOON_S

from dispatcher.clock import NetworkClock
from dispatcher.layer.history import MOST_AT_ONCE, WATCHER_DEPTH, History
from wire import dispatcher_service
from wire.dispatcher_pb2 import BlockId, CreateRequest, Event, WatchRequest


async def exchange(bench: Bench) -> None:
    """Do one of everything."""
    await bench.switch.connect((1, 3))
    await bench.charlie.create(500)
    await bench.charlie.send((block(), "charlie-q0"))
    await bench.alice.receive(block(), "alice-q0")
    await bench.alice.apply(block(), bytes(range(4)) * 125)
    await bench.alice.create(500, number=1, state=CreateRequest.ZEROS)
    await bench.alice.bell_measure(block(), block(1))
    await bench.charlie.measure(block(half=1))


def logged(folder: Path, seed: int) -> list[str]:
    """Return the event log of an exchange in real time, without the times."""
    folder.mkdir()
    path = folder / "events.log"
    config = configuration(folder, seed=seed, event_log=str(path))

    async def run() -> None:
        fibers = with_fibers(config, loss_db_per_km=50.0, depolarizing=0.2)
        async with running(fibers, NetworkClock()) as bench:
            await exchange(bench)

    uvloop.run(run())
    return [line.split(" ", 1)[1] for line in path.read_text().splitlines()]


def test_a_seed_gives_the_same_event_log_again(tmp_path: Path) -> None:
    first, again, other = (
        logged(tmp_path / name, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    assert first == again
    assert first != other
    kinds = [line.split()[1] for line in first]
    assert kinds == [
        "open",
        "create",
        "send",
        "arrive",
        "receive",
        "apply",
        "create",
        "bell-measure",
        "measure",
    ]


class Stream:
    """The stream of a watcher, event by event."""

    def __init__(self, call: Any) -> None:
        self._call = call
        self._events: list[Event] = []
        self.cancel = call.cancel

    async def read(self) -> Event:
        if not self._events:
            report = await self._call.read()
            assert report.events  # a message is never empty
            self._events += report.events
        return self._events.pop(0)


async def watch(bench: Bench, request: WatchRequest) -> Stream:
    """Start watching as the runner."""
    return Stream(bench.stub.Watch(request, metadata=bench.runner.metadata, timeout=SOON_S))


def test_a_watcher_sees_what_it_asked_for(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            await exchange(bench)
            stream = await watch(bench, WatchRequest(node="alice", session=7, history=True))
            kinds = [(await stream.read()).kind for _ in range(5)]
            assert kinds == ["arrive", "receive", "apply", "create", "bell-measure"]
            await bench.charlie.create(1, number=9)
            await bench.alice.create(1, number=10)
            event = await stream.read()
            assert (event.kind, event.block.number) == ("create", 10)
            stream.cancel()

    uvloop.run(run())


def test_a_watcher_is_told_what_has_happened_meanwhile_in_one_message(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            history, pause_s = bench.layer.history, 0.1
            request = WatchRequest(history=True, pause_ms=round(1000 * pause_s))
            began = time.monotonic()
            history.record(event(0))
            call = bench.stub.Watch(request, metadata=bench.runner.metadata, timeout=SOON_S)
            assert [each.block.number for each in (await call.read()).events] == [0]
            for number in range(1, 1 + MOST_AT_ONCE):
                history.record(event(number))
            report = (await call.read()).events
            assert [each.block.number for each in report] == list(range(1, 1 + MOST_AT_ONCE))
            assert time.monotonic() - began >= pause_s
            call.cancel()

    uvloop.run(run())


def test_a_watcher_that_goes_away_is_forgotten(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            await bench.alice.create(1)
            stream = await watch(bench, WatchRequest(history=True))
            await stream.read()
            assert len(bench.layer.history._watchers) == 1
            stream.cancel()
            async with asyncio.timeout(SOON_S):
                while bench.layer.history._watchers:
                    await bench.alice.create(1, number=bench.layer.history.count)

    uvloop.run(run())


def test_a_node_may_not_watch_another(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            await bench.alice.create(1)
            await bench.bob.create(1, number=1)
            for wanted in ("alice", "q1"):
                stream = bench.stub.Watch(
                    WatchRequest(node=wanted, history=True), metadata=bench.bob.metadata
                )
                with pytest.raises(grpc.aio.AioRpcError, match=f"bob may not watch {wanted}"):
                    await stream.read()
            own = bench.stub.Watch(WatchRequest(history=True), metadata=bench.bob.metadata)
            assert {event.node for event in (await own.read()).events} == {"bob"}

    uvloop.run(run())


def test_an_unknown_token_may_not_watch(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            stream = bench.stub.Watch(
                WatchRequest(), metadata=dispatcher_service.metadata("x"), timeout=SOON_S
            )
            with pytest.raises(grpc.aio.AioRpcError) as refusal:
                await stream.read()
            assert refusal.value.code() == grpc.StatusCode.UNAUTHENTICATED

    uvloop.run(run())


def event(number: int) -> Event:
    """Return the event of this number."""
    return Event(time_ns=number, node="alice", kind="create", block=BlockId(number=number))


def test_a_slow_watcher_is_told_how_many_events_it_lost() -> None:
    async def run() -> None:
        history = History(depth=10)
        with history.watching("", 0, remembered=False) as watcher:
            for number in range(WATCHER_DEPTH + 7):
                history.record(event(number))
            seen = [await watcher.next() for _ in range(WATCHER_DEPTH + 1)]
            assert [e.block.number for e in seen[:-1]] == list(range(WATCHER_DEPTH))
            assert seen[-1].kind == "dropped"
            assert seen[-1].detail.startswith("7 events")
            history.record(event(1))
            assert (await watcher.next()).kind == "create"

    uvloop.run(asyncio.wait_for(run(), 20))


def test_history_is_as_deep_as_configured() -> None:
    async def run() -> None:
        history = History(depth=3)
        for number in range(5):
            history.record(event(number))
        with history.watching("", 0, remembered=True) as watcher:
            assert [(await watcher.next()).block.number for _ in range(3)] == [2, 3, 4]

    uvloop.run(asyncio.wait_for(run(), 20))


def test_the_first_photons_of_a_block_have_events_of_their_own_where_asked(tmp_path: Path) -> None:
    log = tmp_path / "events.log"

    async def run() -> list[Event]:
        config = configuration(tmp_path, event_log=str(log), per_qubit=3)
        async with running(config, JumpingClock()) as bench:
            await bench.alice.create(1, number=5)
            stream = await watch(bench, WatchRequest(per_qubit=True, history=True))
            plain = await watch(bench, WatchRequest(history=True))
            for one in (stream, plain):
                assert (await one.read()).block.number == 5  # they watch from here on
            await bench.alice.create(8, state=CreateRequest.ZEROS)
            await bench.alice.apply(block(), bytes([1, 0, 1, 0, 0, 0, 0, 1]))
            await bench.alice.measure(block())
            assert [(await plain.read()).kind for _ in range(3)] == ["create", "apply", "measure"]
            return [await stream.read() for _ in range(27)]

    events = uvloop.run(asyncio.wait_for(run(), 20))
    photons = [event for event in events if event.kind == "measure" and event.photon]
    assert [event.photon for event in photons] == list(range(1, 9))
    assert [event.detail for event in photons] == [f"Z {bit}" for bit in "10100001"]
    assert [e.detail for e in events if e.kind == "apply"][1:4] == ["X", "I", "X"]
    lines = log.read_text().splitlines()
    assert len(lines) == 2 + 3 * (1 + 3)
    assert lines[-1].endswith("photon=3 photons=1 Z 1")


def test_nobody_asked_means_no_event_of_a_photon(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            assert bench.layer.history.photons_wanted == 0

    uvloop.run(run())


def test_events_carry_the_wall_clock_and_answers_the_time_of_the_network(tmp_path: Path) -> None:
    """Both clocks agreed one second of the network, ten seconds here, before the clock began."""
    since_ns = START_NS - 1_000_000_000
    config = replace(configuration(tmp_path), time_scale=10.0, time_since_ns=since_ns)

    async def run() -> None:
        async with running(config, JumpingClock()) as bench:
            report = await bench.alice.create(5)
            stream = await watch(bench, WatchRequest(node="alice", history=True))
            event = await stream.read()
            assert event.kind == "create"
            assert event.time_ns == since_ns + 10 * (report.time_ns - since_ns)

    uvloop.run(run())


class FullDisk(io.StringIO):
    """A log that cannot be written."""

    def write(self, _text: str) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_events_are_written_a_moment_later_and_in_the_end() -> None:
    async def run() -> None:
        log = io.StringIO()
        history = History(10, log, delay_s=0.001)
        history.record(Event(node="alice"))
        assert not log.getvalue()  # who asked has its answer first
        async with asyncio.timeout(SOON_S):
            while "alice" not in log.getvalue():
                await asyncio.sleep(0)
        history.record(Event(node="bob"))
        history.write_out()  # as at the end of the dispatcher
        assert [line.split()[1] for line in log.getvalue().splitlines()] == ["alice", "bob"]

    uvloop.run(run())


def test_what_cannot_be_written_is_an_error_at_the_next_event() -> None:
    async def run() -> None:
        history = History(10, FullDisk(), delay_s=0.001)

        async def go_on() -> None:
            while True:
                history.record(Event(node="alice"))
                await asyncio.sleep(0)

        with pytest.raises(OSError, match="No space left"):
            await asyncio.wait_for(go_on(), 10)

    uvloop.run(run())
