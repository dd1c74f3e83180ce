"""A host's pauses and time-outs count the time of the network."""

import asyncio
import time
from threading import Thread

import pytest
from limits import SOON_S
from stepping import stepping

from hosts import network_loop
from hosts.network_loop import now_s, wall_sleep
from wire.network_time import NetworkTime


def test_a_pause_and_a_time_out_take_k_times_as_long_here() -> None:
    took_s: list[float] = []

    async def pause() -> None:
        began_s = time.monotonic()
        await asyncio.sleep(0.002)
        took_s.append(time.monotonic() - began_s)
        began_s = time.monotonic()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.002):
                await asyncio.get_running_loop().create_future()
        took_s.append(time.monotonic() - began_s)

    network_loop.run(pause(), NetworkTime(50.0))
    # Timers of the loop go in steps of a millisecond.
    assert min(took_s) >= 50 * 0.002 - 0.002


def test_the_clock_of_the_loop_goes_k_times_slower() -> None:
    async def read() -> None:
        before_s = time.monotonic()
        reading_s = now_s()
        after_s = time.monotonic()
        assert before_s / 1000 <= reading_s <= after_s / 1000

    network_loop.run(read(), NetworkTime(1000.0))


def test_what_finds_the_network_does_not_wait_for_its_time() -> None:
    """A millisecond here; of the network it would be 11 days."""
    thread = Thread(
        target=lambda: network_loop.run(wall_sleep(0.001), NetworkTime(1e9)), daemon=True
    )
    thread.start()
    thread.join(SOON_S)
    assert not thread.is_alive()


def test_in_a_loop_that_knows_no_network_time_a_pause_is_what_it_says() -> None:
    network_loop.run(wall_sleep(0.001))


def test_a_deadline_beyond_the_last_nanosecond_comes() -> None:
    """The sum of a time and a time-out is rounded up; stepped, the clock stands while we look."""

    async def act() -> float:
        loop, looks = asyncio.get_running_loop(), 0
        await asyncio.sleep(1015.181000934)
        until_s = loop.time() + 10.0
        assert until_s == 1025.1810009340002
        reached = loop.create_future()

        def look() -> None:
            nonlocal looks
            looks += 1
            if loop.time() >= until_s:
                reached.set_result(loop.time())
            elif looks < 10:
                loop.call_at(until_s, look)
            else:
                reached.set_exception(AssertionError("the clock stands"))

        look()
        return float(await reached)

    with stepping() as gate:
        gate.time.begin()
        assert network_loop.run(act(), gate.time) == 1025.181000935
