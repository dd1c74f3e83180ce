"""Photons that are counted and split off pulses, within 5 standard errors; the seed is 1."""

from collections.abc import Awaitable, Callable
from math import exp
from typing import Any, Literal

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.refusal import Refusal
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

COUNT = 100_000
MEAN = 0.8
LASER = Device(PairSource("poisson", MEAN))


def scene(
    act: Callable[[Laboratory], Awaitable[None]], loss_db: float = 0.0, **changes: Any
) -> None:
    """Let something happen between alice, eve and bob in a row; light is lost before eve."""
    fibers = [
        Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("eve", "eve-q0"), connectors_db=loss_db),
        Fiber(FiberEnd("eve", "eve-q1"), FiberEnd("bob", "bob-q0")),
    ]
    tokens = {name: name for name in ("alice", "eve", "bob")}
    devices = {"alice": LASER, **changes.pop("devices", {})}
    config = DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices, **changes)
    uvloop.run(_act(act, config))


async def _act(act: Callable[[Laboratory], Awaitable[None]], config: DispatcherConfig) -> None:
    await act(Laboratory(config))


@pytest.mark.parametrize("loss_db", [0.0, 3.0])
def test_photons_of_pulses_are_poisson_distributed(loss_db: float) -> None:
    """Also behind a loss, where some pulses have kept others of their photons than the first."""

    async def act(laboratory: Laboratory) -> None:
        alice, eve = laboratory.host("alice"), laboratory.host("eve")
        await alice.prepare(np.zeros(COUNT, np.uint8))
        await alice.send({(0, 0): "alice-q0"})
        await eve.receive((0, 0), "eve-q0")
        counts = await eve.split((0, 0), (9, 0))
        mean, likely = MEAN * 10 ** (-loss_db / 10), exp(-MEAN * 10 ** (-loss_db / 10))
        for number in range(4):
            assert within(int((counts == number).sum()), COUNT, likely)
            likely *= mean / (number + 1)

    scene(act, loss_db=loss_db)


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_both_photons_of_a_pulse_tell_its_bit_and_nothing_is_disturbed(
    backend: Literal["chp", "stim", "dense"],
) -> None:
    async def act(laboratory: Laboratory) -> None:
        size = 3_000
        random = np.random.default_rng(2)
        alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
        states = random.integers(0, 6, size, dtype=np.uint8)
        await alice.prepare(states)
        await alice.send({(0, 0): "alice-q0"})
        await eve.receive((0, 0), "eve-q0")
        counts = await eve.split((0, 0), (9, 0))
        await eve.store((9, 0))
        await eve.send({(0, 0): "eve-q1"})
        await bob.receive((0, 0), "bob-q0")
        found = await bob.measure((0, 0), bases=states >> np.uint8(1))
        np.testing.assert_array_equal(found != NO_CLICK, counts > 0)
        np.testing.assert_array_equal(found[counts > 0], states[counts > 0] & 1)
        hers = await eve.measure((9, 0), bases=states >> np.uint8(1))
        np.testing.assert_array_equal(hers != NO_CLICK, counts > 1)
        np.testing.assert_array_equal(hers[counts > 1], states[counts > 1] & 1)
        assert laboratory.layer.sabot.live_qubits == 0

    scene(act, backend=backend, loss_db=1.0)


def test_no_photon_is_made_or_lost() -> None:
    """Each time one of several is taken, also of what was left before; one alone stays."""

    async def act(laboratory: Laboratory) -> None:
        eve = laboratory.host("eve")
        await laboratory.host("alice").prepare(np.zeros(COUNT, np.uint8))
        await laboratory.host("alice").send({(0, 0): "alice-q0"})
        await eve.receive((0, 0), "eve-q0")
        counts = (await eve.split((0, 0), (9, 0))).astype(int)
        again = (await eve.split((0, 0), (10, 0))).astype(int)
        np.testing.assert_array_equal(again, np.where(counts > 1, counts - 1, counts))
        np.testing.assert_array_equal(await eve.split((9, 0), (11, 0)), counts > 1)
        np.testing.assert_array_equal(await eve.split((10, 0), (12, 0)), counts > 2)

    scene(act)


def test_bob_sees_no_more_than_before_but_for_what_was_taken() -> None:
    """Detectors of 20 %: n photons click with 1 - .8^n, of which eve has left n - 1."""
    mean = 1.5

    async def act(laboratory: Laboratory) -> None:
        eve, bob = laboratory.host("eve"), laboratory.host("bob")
        await laboratory.host("alice").prepare(np.zeros(COUNT, np.uint8))
        await laboratory.host("alice").send({(0, 0): "alice-q0"})
        await eve.receive((0, 0), "eve-q0")
        await eve.split((0, 0), (9, 0))
        await eve.send({(0, 0): "eve-q1"})
        await bob.receive((0, 0), "bob-q0")
        seen = await bob.measure((0, 0))
        clicks = exp(-mean) * mean * 0.2
        likely = exp(-mean) * mean
        for number in range(2, 30):
            likely *= mean / number
            clicks += likely * (1 - 0.8 ** (number - 1))
        assert within(int((seen != NO_CLICK).sum()), COUNT, clicks)

    laser = Device(PairSource("poisson", mean))
    scene(act, devices={"alice": laser, "bob": Device(detectors=Detectors(efficiency=0.2))})


def test_a_name_that_is_taken_is_refused_and_nothing_changes() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        for number in range(2):
            await alice.prepare(np.zeros(10, np.uint8), number)
        live = laboratory.layer.sabot.live_qubits
        for into, text in (((1, 0), "exists"), ((0, 0), "exists"), ((0, 1), "another number")):
            with pytest.raises(Refusal, match=text):
                await alice.split((0, 0), into)
        assert laboratory.layer.sabot.live_qubits == live

    scene(act)
