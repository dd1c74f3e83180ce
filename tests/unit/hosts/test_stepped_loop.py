"""A loop's pauses and time-outs take time of the network, and none of the wall."""

import asyncio
from collections.abc import Coroutine, Iterator
from typing import Any

import pytest
from stepping import SINCE_NS, Stepping, stepping

from dispatcher.clock import clock_of
from dispatcher.layer.journal import Journal
from hosts import network_loop
from hosts.network_loop import now_s, wall_sleep, wall_timeout

HOUR_S = 3_600


@pytest.fixture
def gate() -> Iterator[Stepping]:
    with stepping() as running:
        yield running


def run(gate: Stepping, main: Coroutine[Any, Any, None]) -> None:
    network_loop.run(main, gate.time)


def test_pauses_and_time_outs_end_at_their_instant_to_the_nanosecond(gate: Stepping) -> None:
    async def main() -> None:
        async def pause(seconds: float) -> int:
            await asyncio.sleep(seconds)
            return gate.time.now_ns() - SINCE_NS

        ends = await asyncio.gather(*(pause(each) for each in (2 * HOUR_S, 1e-9, HOUR_S)))
        assert ends == [2 * HOUR_S * 10**9, 1, HOUR_S * 10**9]
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(HOUR_S):
                await asyncio.get_running_loop().create_future()
        assert now_s() == 3 * HOUR_S

    run(gate, main())


def test_a_time_out_that_is_not_needed_makes_no_leap(gate: Stepping) -> None:
    async def main() -> None:
        async with asyncio.timeout(HOUR_S):
            await asyncio.sleep(1)
        await wall_sleep(0.05)
        assert now_s() == 1

    run(gate, main())


def test_a_pause_of_the_wall_makes_no_leap_and_ends_while_time_stands(gate: Stepping) -> None:
    async def main() -> None:
        with pytest.raises(TimeoutError):
            async with wall_timeout(0.05):
                await asyncio.get_running_loop().create_future()
        assert now_s() == 0

    run(gate, main())


def test_the_dispatcher_waits_for_instants_and_gives_up_at_one(gate: Stepping) -> None:
    """Its clock goes on behind an instant, as JumpingClock does in the laboratory."""

    async def main() -> None:
        clock = clock_of(gate.time)
        await clock.wait_until(SINCE_NS + 5)
        assert clock.now_ns() == SINCE_NS + 6
        with pytest.raises(TimeoutError):
            async with Journal(gate.time).timeout(1.0):
                await asyncio.get_running_loop().create_future()
        assert clock.now_ns() == SINCE_NS + 6 + 10**9

    asyncio.run(main())
