"""Runs whose switches store and emit, in which several things happen at a moment, are replayed."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from dispatcher_network import Bench, block
from limits import until
from test_replay import recorded, replayed
from test_switch_analysers import PatientClock

from wire.dispatcher_pb2 import EmitRequest
from wire.parameters.switch import QuantumSwitch


def memories(sources: int = 0) -> dict[str, Any]:
    return {"switches": [QuantumSwitch("q1", memories=2, sources=sources)]}


async def release_two_by_two(bench: Bench) -> None:
    """Let blocks leave two memories at the same moments, the second ones behind the first."""
    await bench.switch.connect((3, 61_001), (4, 61_002))
    for number in range(2):
        for host in (bench.alice, bench.bob):
            own = 2 * number + (host is bench.bob)
            await host.create(20, own)
            await host.send((block(own, 1), "bob-q0" if host is bench.bob else "alice-q0"))
            await bench.transport.landed()
    await bench.switch.connect((61_001, 3), (61_002, 4))
    await bench.transport.landed()


def test_blocks_that_leave_memories_at_the_same_moment_are_replayed(tmp_path: Path) -> None:
    content, log = recorded(tmp_path, PatientClock(), release_two_by_two, **memories())
    assert log.count(" recall ") == 4
    assert replayed(content) == log


class IntrudingClock(PatientClock):
    """One by which a third emission is asked for as the second, behind the first, begins."""

    def __init__(self) -> None:
        """Begin without anybody to ask."""
        super().__init__()
        self.emit: Callable[[int], Awaitable[object]] | None = None
        self.third: asyncio.Task[object] | None = None

    async def wait_until(self, time_ns: int) -> None:
        """Let the third come before callbacks of the task of the second."""
        await super().wait_until(time_ns)
        behind = "_launch_behind" in repr(asyncio.current_task())
        if behind and self.third is None and self.emit is not None:
            self.third = asyncio.ensure_future(self.emit(3))


def test_an_emission_that_comes_as_the_last_one_begins_is_replayed(tmp_path: Path) -> None:
    clock = IntrudingClock()

    async def three(bench: Bench) -> None:
        async def emit(number: int) -> object:
            about = {"session": 8, "number": number, "count": 20, "rate_hz": 50_000_000}
            request = EmitRequest(switch="q1", port=62_001, **about)
            return await bench.service.change("q1", "emit", request)

        clock.emit = emit
        await bench.switch.connect((62_001, 61_001), (62_002, 61_002))
        await emit(1)
        await emit(2)
        await until(lambda: clock.third is not None and clock.third.done())
        await bench.transport.landed()

    content, log = recorded(tmp_path, clock, three, **memories(sources=1))
    assert log.count(" send ") == 6
    assert replayed(content) == log
