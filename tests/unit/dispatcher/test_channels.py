"""Channels of a fibre by wavelength: what gets in, what is lost, and what strays to neighbours.

alice-q0, -q1, -q2 ==== three channels of one fibre ==== bob-q0, -q1, -q2
"""

import asyncio
from collections.abc import Awaitable, Callable
from math import exp
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from limits import SOON_S

from dispatcher.approximations import CROSSTALK
from dispatcher.fiber.channels import Traffic
from dispatcher.fiber.noise import Pattern, Schedule
from dispatcher.layer.ownership import BlockName
from evidence.laboratory import RATE_HZ, SESSION, Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.parameters.fiber import optics
from wire.parameters.physics import Device, PairSource

COUNT = 40_000
CHANNELS = 3
MINUTE_NS = 60 * 10**9
SHARE = 0.1  # of the light of a channel, in each neighbouring one: 10 dB
ALL_IN_STEP = {"pulse_window_s": 1 / RATE_HZ}  # one pulse of a neighbour comes with each


def scene(act: Callable[[Laboratory], Awaitable[None]], **fiber: Any) -> None:
    described = optics("it", channels=CHANNELS, **fiber)
    ends = [(FiberEnd("alice", f"alice-q{n}"), FiberEnd("bob", f"bob-q{n}")) for n in range(3)]
    fibers = [
        Fiber.joining(*pair, described, channel, "alice 1")
        for channel, pair in enumerate(ends, start=1)
    ]
    tokens = {name: name for name in ("alice", "bob")}
    devices = {name: Device(PairSource("single")) for name in tokens}
    config = DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)

    async def run() -> None:
        await act(Laboratory(config))

    uvloop.run(run())


def frequency_mhz(channel: int) -> int:
    """Return it by the grid of ITU-T G.694.1: 193.1 THz and multiples of 100 GHz."""
    return 193_100_000 + 100_000 * (channel + 2)


class OnceAllAreSent:
    """The laboratory's clock, which does not jump before all light of a scene is on its way."""

    def __init__(self, laboratory: Laboratory, blocks: int) -> None:
        self._clock, self._ownership = laboratory.layer.clock, laboratory.layer.ownership
        self._blocks = blocks

    def now_ns(self) -> int:
        return self._clock.now_ns()

    async def wait_until(self, time_ns: int) -> None:
        async with asyncio.timeout(SOON_S):
            while self._flying() < self._blocks:
                await asyncio.sleep(0)
        self._blocks = 0
        await self._clock.wait_until(time_ns)

    def _flying(self) -> int:
        names = [BlockName(SESSION, number, 0) for number in range(20)]
        return sum(not part.node for name in names for part in self._ownership.parts(name))


async def light(laboratory: Laboratory, **channels: list[int]) -> None:
    """Let hosts send zeros in these channels, all at the same time; bob's blocks begin at 10."""
    sent = [(host, channel) for host, theirs in channels.items() for channel in theirs]
    numbers = [channel + 10 * (host == "bob") for host, channel in sent]
    laboratory.layer.clock = OnceAllAreSent(laboratory, len(sent))
    for number, (host, _channel) in zip(numbers, sent, strict=True):
        await laboratory.host(host).prepare(np.zeros(COUNT, np.uint8), number)
    await asyncio.gather(
        *(
            laboratory.host(host).send(
                {(number, 0): f"{host}-q{channel - 1}"}, RATE_HZ, frequency_mhz(channel)
            )
            for number, (host, channel) in zip(numbers, sent, strict=True)
        )
    )


async def seen(laboratory: Laboratory, channel: int) -> tuple[int, int]:
    """Return how many of the zeros of a channel bob has seen, and how many as ones."""
    bob = laboratory.host("bob")
    await bob.receive((channel, 0), f"bob-q{channel - 1}")
    bits = await bob.measure((channel, 0))
    return int(np.count_nonzero(bits < 2)), int(np.count_nonzero(bits == 1))


@pytest.mark.parametrize(("channel", "neighbours"), [(1, 1), (2, 2), (3, 1)])
def test_strays_of_neighbours_make_errors_as_the_closed_form_says(
    channel: int, neighbours: int
) -> None:
    """Of n neighbours come mu = n s strays in a pulse, Poisson distributed, in either detector.

    The own photon stays with 1 - n s. The wrong detector clicks with 1 - e^(-mu / 2). Where both
    click, the bit is taken at random; without an own photon it is random anyway.
    """

    async def act(laboratory: Laboratory) -> None:
        await light(laboratory, alice=[1, 2, 3])
        clicks, errors = await seen(laboratory, channel)
        stays, strays = 1 - neighbours * SHARE, neighbours * SHARE
        alone = (1 - stays) * (1 - exp(-strays))
        assert within(clicks, COUNT, stays + alone)
        assert within(errors, COUNT, stays * (1 - exp(-strays / 2)) / 2 + alone / 2)
        assert laboratory.layer.approximations.sizes == {
            CROSSTALK: pytest.approx(1 - exp(-strays))  # pulses that any of it is in
        }

    scene(act, channel_crosstalk_db=10.0, **ALL_IN_STEP)


def test_alone_a_channel_loses_what_strays_and_nothing_comes_to_it() -> None:
    async def act(laboratory: Laboratory) -> None:
        await light(laboratory, alice=[2])
        clicks, errors = await seen(laboratory, 2)
        assert within(clicks, COUNT, 1 - 2 * SHARE)
        assert errors == 0

    scene(act, channel_crosstalk_db=10.0, **ALL_IN_STEP)


def test_light_that_goes_the_other_way_does_not_stray_here() -> None:
    async def act(laboratory: Laboratory) -> None:
        await light(laboratory, alice=[2], bob=[1, 3])
        _clicks, errors = await seen(laboratory, 2)
        assert errors == 0

    scene(act, channel_crosstalk_db=10.0, **ALL_IN_STEP)


def test_without_crosstalk_channels_know_nothing_of_each_other() -> None:
    async def act(laboratory: Laboratory) -> None:
        await light(laboratory, alice=[1, 2, 3])
        assert [await seen(laboratory, channel) for channel in (1, 2, 3)] == [(COUNT, 0)] * 3
        assert laboratory.layer.exact

    scene(act, **ALL_IN_STEP)


def test_multiplexers_lose_their_share_in_each_channel() -> None:
    async def act(laboratory: Laboratory) -> None:
        await light(laboratory, alice=[1, 3])
        for channel in (1, 3):
            clicks, _errors = await seen(laboratory, channel)
            assert within(clicks, COUNT, 10**-0.35)

    scene(act, multiplexer_db=3.5)


def test_light_of_another_colour_does_not_get_in() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        for number, (colour, passes) in enumerate(
            [
                (frequency_mhz(2), True),
                (frequency_mhz(2) + 49_000, True),  # less than half the grid away
                (frequency_mhz(2) + 50_000, False),
                (frequency_mhz(1), False),
            ]
        ):
            await alice.prepare(np.zeros(10, np.uint8), number)
            await alice.send({(number, 0): "alice-q1"}, RATE_HZ, colour)
            assert (await bob.receive((number, 0), "bob-q1") is not None) == passes

    scene(act)


def test_a_window_of_picoseconds_has_the_photons_that_come_within_it() -> None:
    """Of two channels one is .4 ns late: a window of .6 ns has none of it, one of 1 ns has all."""
    pattern = Pattern(2.5, 100)  # half a nanosecond between times that are rounded to whole ones
    traffic = Traffic()
    traffic.add(Schedule(7, pattern, 400.0), 1.0)
    own = Schedule(7, pattern)
    for window_ns, expected in ((0.6, 0), (1.0, 1)):
        found = traffic.photons(own.times_ns, window_ns, pattern.rests_ps)
        assert found.tolist() == [expected] * 100


def test_photons_in_windows_are_those_that_an_enumeration_finds() -> None:
    random = np.random.default_rng(5)
    for _ in range(200):
        interval_ns, photons = float(random.integers(1, 50)), int(random.integers(1, 40))
        schedule = Schedule(int(random.integers(0, 500)), Pattern(interval_ns, photons))
        window_ns = 2 * int(random.integers(1, 60)) - 1  # odd: no pulse is at an edge
        times_ns = np.sort(random.integers(0, 1_000, 30))
        traffic = Traffic()
        traffic.add(schedule, 0.5)
        there = schedule.times_ns
        expected = [0.5 * int((abs(there - t) < window_ns / 2).sum()) for t in times_ns]
        assert traffic.photons(times_ns, window_ns).tolist() == expected


@pytest.mark.parametrize(("later_ns", "kept"), [(0, 2), (MINUTE_NS, 2), (MINUTE_NS + 1, 1)])
def test_light_of_the_last_minute_is_remembered(later_ns: int, kept: int) -> None:
    """It has left 99 ns before, and may stray into what is asked for only now."""
    traffic, pattern = Traffic(), Pattern(1.0, 100)
    traffic.add(Schedule(0, pattern), 1.0)
    traffic.add(Schedule(99 + later_ns, pattern), 1.0)
    assert len(traffic.passing) == kept
