"""The carrying out of orders, on an event loop: waits that end in time, light that nobody wants."""

import asyncio
import gc
import time
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Coincidences, NoLight
from hosts.middleware.session.performing import Performer
from hosts.middleware.session.protocol import (
    Await,
    Cancel,
    Collect,
    Concurrently,
    Steps,
    WaitUntil,
    begin,
    together,
)

FOUND = Coincidences(np.array([1, 2], np.uint8), 4, 9)
PORTS = ("q0", "q1")


class Analyser:
    """A Bell analyser whose light comes when it is let."""

    def __init__(self) -> None:
        self.light: dict[int, asyncio.Future[Coincidences]] = {}
        self.given_up: list[BlockName] = []
        self.cancelled: list[int] = []

    async def detect_pairs(self, _session: int, number: int, *_how: Any) -> Coincidences:
        """Wait for light of a block."""
        self.light[number] = asyncio.get_running_loop().create_future()
        try:
            return await self.light[number]
        except asyncio.CancelledError:
            self.cancelled.append(number)
            raise

    def give_up(self, *blocks: BlockName) -> None:
        """Let it be lost."""
        self.given_up += blocks
        for block in {block.number for block in blocks}:
            self.light[block].set_exception(NoLight("lost"))


def performed(steps: Callable[[Analyser], Steps[Any]]) -> tuple[Any, Analyser]:
    """Carry steps out; return what they do, and the analyser."""

    async def run() -> tuple[Any, Analyser]:
        analyser = Analyser()
        performer = Performer(cast(Qnic, analyser))
        return await performer.perform_together(steps(analyser)), analyser

    return asyncio.run(run())


def test_of_several_that_are_under_way_those_that_are_over_are_told_and_the_others_go_on() -> None:
    def steps(analyser: Analyser) -> Steps[Any]:
        lights = []
        for number in (1, 2):
            lights.append((yield from begin(pair_light.detect_pairs, 7, number, PORTS, 1.0)))
        before = yield Await(tuple(lights), 0.01)
        analyser.light[2].set_result(FOUND)
        after = yield Await(tuple(lights))
        second = yield Collect(lights[1])
        analyser.light[1].set_result(FOUND)
        return before, after, second, (yield Collect(lights[0]))

    report, analyser = performed(steps)
    assert report == ((False, False), (False, True), FOUND, FOUND)
    assert (analyser.given_up, analyser.cancelled) == ([], [])


def test_light_that_is_late_is_given_up_by_the_names_of_both_halves() -> None:
    def steps(_analyser: Analyser) -> Steps[Any]:
        light = yield from begin(pair_light.detect_pairs, 7, 3, PORTS, 1.0)
        return (yield Collect(light, 0.01))

    found, analyser = performed(steps)
    assert found is None
    assert analyser.given_up == [BlockName(7, 3, 0), BlockName(7, 3, 1)]


def test_light_that_is_cancelled_is_not_waited_for_when_steps_go_on() -> None:
    def steps(analyser: Analyser) -> Steps[Any]:
        light = yield from begin(pair_light.detect_pairs, 7, 3, PORTS, 1.0)
        yield Await((light,), 0.01)
        yield Cancel(light)
        return list(analyser.cancelled)

    assert performed(steps)[0] == [3]


def test_what_nobody_collects_fails_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    def steps(analyser: Analyser) -> Steps[Any]:
        light = yield from begin(pair_light.detect_pairs, 7, 3, PORTS, 1.0)
        yield Await((light,), 0.01)
        analyser.light[3].set_exception(NoLight("lost"))
        return (yield Await((light,)))

    assert performed(steps)[0] == (True,)
    gc.collect()  # then asyncio would complain
    assert caplog.records == []


def test_a_wait_for_what_others_bring_about_ends_in_time() -> None:
    done: list[int] = []

    def other() -> Steps[None]:
        yield WaitUntil(lambda: False, 0.05)
        done.append(1)

    def steps(_analyser: Analyser) -> Steps[Any]:
        yield Concurrently(other())
        began_s = time.monotonic()
        early = yield WaitUntil(lambda: done, 0.01)
        waited_s = time.monotonic() - began_s
        return early, waited_s, (yield WaitUntil(lambda: done))

    (early, waited_s, late), _analyser = performed(steps)
    assert (early, late) == (False, True)
    assert waited_s >= 0.01


def test_steps_together_both_go_on_and_the_first_failure_ends_both() -> None:
    def light(number: int) -> Steps[Any]:
        return (yield Collect((yield from begin(pair_light.detect_pairs, 7, number, PORTS, 1.0))))

    def lets(analyser: Analyser) -> Steps[Any]:
        yield WaitUntil(lambda: False, 0.01)
        for number in (2, 1):
            analyser.light[number].set_result(FOUND)
        return number

    def steps(analyser: Analyser) -> Steps[Any]:
        return (yield from together(together(light(1), light(2)), lets(analyser)))

    assert performed(steps)[0] == ((FOUND, FOUND), 1)

    def breaks(_analyser: Analyser) -> Steps[Any]:
        yield WaitUntil(lambda: False, 0.01)
        raise NoLight("broken")

    with pytest.raises(NoLight, match="broken"):
        performed(lambda analyser: together(light(1), breaks(analyser)))
