"""The hardware follows the flow table: with an optical switch that the tests hold in hand."""

import asyncio
from collections.abc import Coroutine, Iterable
from typing import Any

import pytest

from qswitch_agent.hardware.optics import HardwareFault, HardwareRefusal
from qswitch_agent.light_paths import LightPaths, NotReady
from qswitch_agent.middleware import CrossConnect
from qswitch_agent.openflow import ADDED, REMOVED, FlowEntry, FlowUpdate

DEADLINE_S = 5.0


class Mirrors:
    """Optical hardware; each call takes until `free` is set."""

    def __init__(self) -> None:
        self.calls: list[set[tuple[int, int]]] = []
        self.failure: Exception | None = None
        self.free = asyncio.Event()
        self.free.set()

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        self.calls.append(set(cross_connects))
        await self.free.wait()
        if self.failure:
            raise self.failure

    async def watch(self) -> None:
        await asyncio.Event().wait()


def path(in_port: int, out_port: int, event: int = ADDED) -> FlowUpdate:
    return FlowUpdate(event, FlowEntry(1, bytes([in_port]), in_port, False, out_port))


def play(scene: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scene, DEADLINE_S))


async def settle() -> None:
    """Let every task run until it waits."""
    for _turn in range(10):
        await asyncio.sleep(0)


def test_start_sets_the_hardware_even_to_nothing() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2], mirrors)
        running = asyncio.create_task(paths.run())
        await paths.ready()
        assert mirrors.calls == [set()]
        running.cancel()

    play(scene())


def test_changes_of_one_batch_are_one_call() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2, 3, 4], mirrors)
        running = asyncio.create_task(paths.run())
        await paths.ready()
        paths.update([path(1, 2), path(3, 4)])
        await paths.ready()
        assert mirrors.calls[1:] == [{(1, 2), (3, 4)}]
        running.cancel()

    play(scene())


def test_unchanged_set_is_not_asked_for_again() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2], mirrors)
        running = asyncio.create_task(paths.run())
        paths.update([path(1, 2)])
        await paths.ready()
        paths.update([path(1, 2), path(2, 9)])
        await paths.ready()
        assert mirrors.calls == [{(1, 2)}]
        running.cancel()

    play(scene())


def test_ready_waits_for_the_change_before_it_not_for_later_ones() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2, 3, 4], mirrors)
        running = asyncio.create_task(paths.run())
        await paths.ready()
        mirrors.free.clear()
        paths.update([path(1, 2)])
        first = asyncio.create_task(paths.ready())
        await settle()
        paths.update([path(3, 4)])
        second = asyncio.create_task(paths.ready())
        await settle()
        assert not first.done()
        assert mirrors.calls == [set(), {(1, 2)}]
        mirrors.free.set()
        await asyncio.wait([first, second], return_when=asyncio.ALL_COMPLETED)
        assert mirrors.calls == [set(), {(1, 2)}, {(1, 2), (3, 4)}]
        running.cancel()

    play(scene())


def test_refusal_is_told_until_the_table_changes() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2], mirrors)
        running = asyncio.create_task(paths.run())
        await paths.ready()
        mirrors.failure = HardwareRefusal("the mirror is stuck")
        paths.update([path(1, 2)])
        for _time in range(2):
            with pytest.raises(NotReady, match="1->2: the mirror is stuck"):
                await paths.ready()
        mirrors.failure = None
        paths.update([path(1, 2, REMOVED)])
        await paths.ready()
        assert mirrors.calls == [set(), {(1, 2)}]
        running.cancel()

    play(scene())


def test_fault_is_told_to_all_and_ends_the_run() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2], mirrors)
        running = asyncio.create_task(paths.run())
        await paths.ready()
        mirrors.failure = HardwareFault("the laser is off")
        paths.update([path(1, 2)])
        with pytest.raises(HardwareFault, match="the laser is off"):
            await paths.ready()
        with pytest.raises(HardwareFault):
            await running

    play(scene())


def test_conflict_is_not_ready_though_the_other_path_is_made() -> None:
    async def scene() -> None:
        mirrors = Mirrors()
        paths = LightPaths([1, 2, 3], mirrors)
        running = asyncio.create_task(paths.run())
        paths.update([path(1, 3), path(2, 3)])
        with pytest.raises(NotReady, match="from port 2 to port 3"):
            await paths.ready()
        assert mirrors.calls == [{(1, 3)}]
        running.cancel()

    play(scene())
