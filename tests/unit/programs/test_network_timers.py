"""Waits of event loops in stepped time."""

import asyncio
from typing import Any

from stepping import SINCE_NS, stepping

from programs.network_timers import background_sleep, close_timers, sleep_until, timeout


def test_a_pause_in_the_background_ends_when_the_clock_has_passed_it() -> None:
    """The clock leaps to what others wait for, and to no pause."""

    async def act() -> list[float]:
        loop, woken = asyncio.get_running_loop(), []

        async def pause() -> None:
            await background_sleep(gate.time, 1)
            woken.append(gate.time.now_s())

        async with asyncio.TaskGroup() as group:
            group.create_task(pause())
            await sleep_until(gate.time, SINCE_NS + 500_000_000)
            assert not woken
            await sleep_until(gate.time, SINCE_NS + 3_000_000_000)
        close_timers(loop)
        return woken

    with stepping() as gate:
        gate.time.begin()
        assert asyncio.run(act()) == [3]


def test_a_wait_that_ended_in_time_leaves_no_timer() -> None:
    """Its limit passes later, without a call."""

    async def act() -> list[dict[str, Any]]:
        loop, errors = asyncio.get_running_loop(), list[dict[str, Any]]()
        loop.set_exception_handler(lambda _loop, context: errors.append(context))
        async with timeout(gate.time, 2):
            await sleep_until(gate.time, SINCE_NS + 1_000_000_000)
        await sleep_until(gate.time, SINCE_NS + 3_000_000_000)
        close_timers(loop)
        return errors

    with stepping() as gate:
        gate.time.begin()
        assert asyncio.run(act()) == []
