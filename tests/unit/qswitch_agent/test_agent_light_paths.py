"""The hardware follows the flow table: with an optical switch that the tests hold in hand."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from types import SimpleNamespace

import pytest
from limits import until
from openflow_messages import FIBERS, port
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import Optics, Reports, play

from qswitch_agent import light_paths, timeouts
from qswitch_agent.bridge import Commands, SupervisoryChannels
from qswitch_agent.hardware.optics import (
    CircuitReading,
    HardwareFault,
    HardwareRefusal,
    Quantity,
    Readings,
)
from qswitch_agent.light_paths import LightPaths, Removed
from qswitch_agent.openflow import matches
from qswitch_agent.openflow.flow_reports import ADDED, REMOVED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.switch import Switch
from topologies.timeouts import READY_TIMEOUT_S

SECOND_NS = 1_000_000_000


def entry(in_port: int, out_port: int, mark: Mark | None = None) -> FlowEntry:
    return FlowEntry(1, matches.of_port(in_port), in_port, False, out_port, 7, mark)


def path(in_port: int, out_port: int, event: int = ADDED) -> FlowUpdate:
    return FlowUpdate(event, entry(in_port, out_port))


@asynccontextmanager
async def running(*ports: int) -> AsyncIterator[tuple[LightPaths, Optics]]:
    """Light paths over hardware that is up to date."""
    optics = Optics()
    paths = LightPaths(ports, optics)
    task = asyncio.create_task(paths.run())
    await paths.ready()
    yield paths, optics
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def made(optics: Optics) -> list[set[tuple[int, int]]]:
    return [{(one.in_port, one.out_port) for one in call} for call in optics.calls]


async def settle() -> None:
    """Let every task run until it waits."""
    for _turn in range(10):
        await asyncio.sleep(0)


def test_start_sets_the_hardware_even_to_nothing() -> None:
    async def scene() -> None:
        async with running(1, 2) as (_paths, optics):
            assert optics.calls == [set()]

    play(scene())


def test_changes_of_one_batch_are_one_call() -> None:
    async def scene() -> None:
        async with running(1, 2, 3, 4) as (paths, optics):
            paths.update([path(1, 2), path(3, 4)])
            await paths.ready()
            assert made(optics)[1:] == [{(1, 2), (3, 4)}]

    play(scene())


def test_unchanged_set_is_not_asked_for_again() -> None:
    async def scene() -> None:
        async with running(1, 2) as (paths, optics):
            paths.update([path(1, 2)])
            await paths.ready()
            paths.update([path(1, 2), path(2, 9)])
            await paths.ready()
            assert made(optics) == [set(), {(1, 2)}]

    play(scene())


def test_path_that_is_removed_and_added_again_is_dark_in_between() -> None:
    async def scene() -> None:
        async with running(1, 2, 3, 4, 5, 6) as (paths, optics):
            paths.update([path(1, 2), path(3, 4)])
            await paths.ready()
            # Both are there before the hardware has been asked; 5->6 has never been dark.
            paths.update([path(1, 2, REMOVED), path(1, 2), path(5, 6), path(5, 6, REMOVED)])
            await paths.ready()
            assert made(optics)[2:] == [{(3, 4)}, {(1, 2), (3, 4)}]
            paths.update([path(3, 4)])  # takes the place of its like: never dark
            await paths.ready()
            assert made(optics)[4:] == []

    play(scene())


def test_removed_entry_of_lower_priority_leaves_the_light_of_its_like() -> None:
    async def scene() -> None:
        async with running(1, 2) as (paths, optics):
            above = replace(entry(1, 2), priority=2)
            paths.update([FlowUpdate(ADDED, above), path(1, 2)])
            await paths.ready()
            paths.update([path(1, 2, REMOVED), path(1, 2)])
            await paths.ready()
            assert made(optics) == [set(), {(1, 2)}]

    play(scene())


def test_ready_waits_for_the_change_before_it_not_for_later_ones() -> None:
    async def scene() -> None:
        async with running(1, 2, 3, 4) as (paths, optics):
            optics.free.clear()
            paths.update([path(1, 2)])
            first = asyncio.create_task(paths.ready())
            await settle()
            paths.update([path(3, 4)])
            second = asyncio.create_task(paths.ready())
            await settle()
            assert not first.done()
            assert made(optics) == [set(), {(1, 2)}]
            optics.free.set()
            await asyncio.gather(first, second)
            assert made(optics) == [set(), {(1, 2)}, {(1, 2), (3, 4)}]

    play(scene())


def test_one_refused_path_does_not_keep_the_others_from_being_made(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scene() -> None:
        async with running(1, 2, 3, 4, 5, 6) as (paths, optics):
            paths.update([path(1, 2)])
            await paths.ready()
            optics.refused = {(3, 4)}
            paths.update([path(3, 4), path(5, 6)])
            await paths.ready()
            assert optics.paths == {(1, 2), (5, 6)}
            # The standing path was in every set that the hardware took: it was not interrupted.
            assert all((1, 2) in call for call in made(optics)[1:])

    play(scene())
    assert "the hardware refuses 3->4: the mirror is stuck" in caplog.messages


def test_what_stood_and_is_refused_now_does_not_block_the_rest() -> None:
    async def scene() -> None:
        async with running(1, 2, 3, 4, 5, 6) as (paths, optics):
            paths.update([path(1, 2), path(5, 6)])
            await paths.ready()
            optics.refused = {(1, 2)}
            paths.update([path(3, 4)])
            await paths.ready()
            assert optics.paths == {(3, 4), (5, 6)}

    play(scene())


def test_what_was_refused_is_asked_for_again_when_it_may_have_changed() -> None:
    async def scene() -> None:
        async with running(1, 2) as (paths, optics):
            paths.update_stuck(frozenset())
            optics.refused = {(1, 2)}
            paths.update([path(1, 2)])
            await paths.ready()
            assert optics.paths == set()
            optics.refused = set()
            paths.update_stuck(frozenset())
            await paths.ready()
            assert optics.paths == {(1, 2)}
            calls = len(optics.calls)
            paths.update_stuck(frozenset())
            await paths.ready()
            assert len(optics.calls) == calls

    play(scene())


def test_what_is_known_to_be_stuck_is_not_asked_for() -> None:
    async def scene() -> None:
        async with running(1, 2, 3, 4) as (paths, optics):
            paths.update_stuck(frozenset({(1, 3)}))
            paths.update([path(1, 2), path(3, 4)])
            await paths.ready()
            assert made(optics) == [set(), {(3, 4)}]
            paths.update_stuck(frozenset())
            await paths.ready()
            assert optics.paths == {(1, 2), (3, 4)}

    play(scene())


def test_fault_is_told_to_all_and_ends_the_run() -> None:
    async def scene() -> None:
        optics = Optics()
        paths = LightPaths([1, 2], optics)
        task = asyncio.create_task(paths.run())
        await paths.ready()
        optics.failure = HardwareFault("the laser is off")
        paths.update([path(1, 2)])
        with pytest.raises(HardwareFault, match="the laser is off"):
            await paths.ready()
        with pytest.raises(HardwareFault):
            await task

    play(scene())


def test_of_two_paths_into_one_port_one_is_made(caplog: pytest.LogCaptureFixture) -> None:
    async def scene() -> None:
        async with running(1, 2, 3) as (paths, optics):
            paths.update([path(1, 3), path(2, 3)])
            await paths.ready()
            assert optics.paths == {(1, 3)}

    play(scene())
    assert "no path from port 2 to port 3: the path from port 1 ends there" in caplog.messages


def test_cut_fibre_has_no_path_until_it_is_whole_again() -> None:
    async def scene() -> None:
        async with running(1, 2) as (paths, optics):
            paths.update([path(1, 2)])
            for state, expected in ((ofp.OFPPS_LINK_DOWN, set()), (0, {(1, 2)})):
                paths.update_ports([port(2, state=state), port(9, state=state)])
                await paths.ready()
                assert optics.paths == expected

    play(scene())


def test_removed_light_entry_is_remembered_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(light_paths, "MAX_REMOVED", 2)
    paths = LightPaths([1, 2, 3], Optics())
    entries = [entry(number, 4 - number, Mark(5, number)) for number in (1, 3)]
    entries.append(entry(2, 1, Mark(5, 2)))
    plain = entry(1, 2)
    for one in (*entries, plain):
        paths.update([FlowUpdate(ADDED, one)])
        paths.update([FlowUpdate(REMOVED, one)])
    known = [paths.removed(*one.key, one.cookie) for one in entries]
    assert known == [None, Removed(Mark(5, 3)), Removed(Mark(5, 2))]
    assert paths.removed(*entries[1].key, 8) is None


INITIAL = ofp.OFPFME_INITIAL


class Expiry:
    """Light paths whose idle entries are deleted, as the bridge would do it at once."""

    def __init__(self, paths: LightPaths, optics: Optics) -> None:
        self.paths, self.optics = paths, optics
        self.deleted: list[FlowEntry] = []
        self.now_s = 1_700_000_000.0  # goes on only when a test says so

    def add(self, circuit: int, idle_timeout_s: int = 1, event: int = INITIAL) -> FlowEntry:
        """Add an entry, by default one that was there before the agent."""
        one = entry(1, 2, Mark(idle_timeout_s, circuit))
        self.paths.update([FlowUpdate(event, one)])
        return one

    def read(self, **last_s_ago: float) -> None:
        """Say how long ago the last photon of circuits passed."""
        readings = {
            int(name.strip("c")): CircuitReading(1, 0, round((self.now_s - ago) * SECOND_NS))
            for name, ago in last_s_ago.items()
        }
        self.optics.readings = Readings(circuits=readings)

    async def has_deleted(self, one: FlowEntry) -> None:
        """Wait until an entry is deleted, which must be the only one."""
        await until(lambda: self.deleted)
        assert self.deleted == [one]

    def delete(self, one: FlowEntry) -> None:
        self.deleted.append(one)
        self.paths.update([FlowUpdate(REMOVED, one)])


@asynccontextmanager
async def expiring(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Expiry]:
    monkeypatch.setattr(light_paths, "IDLE_POLL_S", 0.002)
    optics = Optics()
    paths = LightPaths([1, 2], optics)
    expiry = Expiry(paths, optics)
    clock = SimpleNamespace(time_ns=lambda: round(expiry.now_s * SECOND_NS))
    monkeypatch.setattr("wire.network_time.time", clock)
    task = asyncio.create_task(paths.expire(expiry.delete))
    yield expiry
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def several_polls() -> None:
    """Let what must not happen have its chance; nothing else waits so."""
    await asyncio.sleep(0.03)


def test_entry_without_photons_expires_and_is_known_as_idle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            one = expiry.add(5)
            expiry.read(c5=0.9)
            await several_polls()
            assert expiry.deleted == []
            expiry.read(c5=1.1)
            await expiry.has_deleted(one)
            assert expiry.paths.removed(*one.key, one.cookie) == Removed(Mark(1, 5), idle=True)

    play(scene())


def test_photons_keep_an_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            expiry.add(5)
            for _time in range(5):
                expiry.read(c5=0.5)
                await several_polls()
            assert expiry.deleted == []

    play(scene())


def test_refused_reading_expires_nothing_and_is_asked_for_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            one = expiry.add(5)
            expiry.read(c5=2)
            expiry.optics.failure = HardwareRefusal("not now")
            await several_polls()
            assert expiry.deleted == []
            expiry.optics.failure = None
            await expiry.has_deleted(one)

    play(scene())


def test_entry_without_an_idle_time_out_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            expiry.add(5, idle_timeout_s=0)
            expiry.read(c5=1000)
            await several_polls()
            assert expiry.deleted == []

    play(scene())


def test_entry_that_takes_the_place_of_its_like_starts_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            expiry.add(5)
            expiry.add(5, event=ADDED)
            expiry.read(c5=2)
            await several_polls()
            assert expiry.deleted == []

    play(scene())


def test_hardware_that_counts_no_photons_expires_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            expiry.add(5)
            expiry.read(c5=2)
            readings = expiry.optics.readings
            expiry.optics.readings = replace(readings, not_measured=frozenset({Quantity.PHOTONS}))
            await several_polls()
            assert expiry.deleted == []

    play(scene())


def test_entry_that_is_added_again_starts_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            expiry.add(5)
            expiry.read(c5=0.9)
            await several_polls()
            again = expiry.add(6)
            expiry.read(c5=2, c6=0.1)
            await several_polls()
            assert expiry.deleted == []
            expiry.delete(again)
            removed = expiry.paths.removed(*again.key, again.cookie)
            assert removed == Removed(Mark(1, 6), idle=False)

    play(scene())


def test_entry_that_no_light_meets_expires_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            one = expiry.add(5)
            for passed_s in (0, 0.5, 0.499):
                expiry.now_s += passed_s
                await several_polls()
                assert expiry.deleted == []
            expiry.now_s += 0.002
            await expiry.has_deleted(one)

    play(scene())


def test_time_counts_from_the_last_photon_though_the_hardware_has_forgotten_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene() -> None:
        async with expiring(monkeypatch) as expiry:
            expiry.add(5)
            await several_polls()
            expiry.now_s += 0.8
            expiry.read(c5=0.0)
            await several_polls()
            expiry.read()
            expiry.now_s += 0.9
            await several_polls()
            assert expiry.deleted == []

    play(scene())


def test_hardware_that_does_not_tell_its_condition_is_a_fault_after_the_time_of_a_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Programs start together: it is longer than of an order; the runner gives up in 20 s."""
    assert timeouts.CALL_DEADLINE_S < 15 == timeouts.CONDITION_DEADLINE_S < READY_TIMEOUT_S == 20
    monkeypatch.setattr("qswitch_agent.switch.CONDITION_DEADLINE_S", 0.05)

    async def scene() -> None:
        optics, commands = Optics(), Commands("/nowhere")
        paths = LightPaths(FIBERS, optics)
        channels = SupervisoryChannels(FIBERS, commands)
        switch = Switch(paths, channels, optics, Reports(paths).synchronise, commands.delete)
        with pytest.raises(HardwareFault, match=r"did not tell its condition in 0\.05 s"):
            await switch.started()

    play(scene())
