"""Photons of one pulse are lost and err each by itself: 5 sigma, the seed is 1.

A Poisson pulse of mean m in a known state, whose photons are each read wrongly with e: either of
two detectors sees Poisson light, of m(1 - e) and m e. Where both click, the bit is a random one. Of
pulses that are seen this is wrong (`wrong`):

    (P(only the wrong one) + P(both) / 2) / P(any) = (1 - exp(-m e) + exp(-m(1 - e)) - exp(-m))
                                                     / 2 (1 - exp(-m))

If all photons of a pulse erred together, it would be e.
"""

from collections.abc import Awaitable, Callable
from math import exp, pi
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.devices.hardware import Moment
from dispatcher.fiber.noise import Effect, Passage
from dispatcher.operations.adjustment import adjust
from evidence.laboratory import RATE_HZ, Laboratory, LaboratoryHost
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import AdjustFiberRequest, Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, Gates, Memory, PairSource, Sensor

COUNT, MEAN = 200_000, 1.9
ONE, PLUS = 1, 2
FLIP, FLIP_OLD, LOSE = (f"{__file__}:{name}" for name in ("Flip", "FlipOld", "Lose"))


class Flip:
    """A model of a user's own: X with some probability, for each photon that it is given."""

    def __init__(self, flip: float = 0.25) -> None:
        """Flip so often."""
        self.flip = flip

    def effect(self, passage: Passage) -> Effect:
        """Flip each by itself."""
        return Effect(paulis=passage.happens("flip", self.flip).astype(np.uint8))


class FlipOld:
    """A model of a user's own: X to each photon that has waited for more than a second."""

    def effect(self, moment: Moment) -> Effect:
        """Flip by the wait alone."""
        return Effect(paulis=(moment.waited_s > 1.0).astype(np.uint8))


class Lose:
    """A model of a user's own that loses a half of the photons that it is given."""

    def effect(self, passage: Passage) -> Effect:
        """Lose each by itself."""
        return Effect(lost=passage.happens("lost", 0.5))


def wrong(error: float, mean: float = MEAN) -> float:
    """Return which share of the seen pulses is read wrongly."""
    only = exp(-mean * (1 - error)) - exp(-mean)  # the wrong detector alone
    both = (1 - exp(-mean * (1 - error))) * (1 - exp(-mean * error))
    return (only + both / 2) / (1 - exp(-mean))


def weak_pulses(
    state: int,
    act: "Act",
    device: Device,
    tapped: float = 0.0,
    mean: float = MEAN,
    rate_hz: int = RATE_HZ,
    **fiber: Any,
) -> np.ndarray:
    """Send weak pulses of one state from alice to bob; return what he measures at last."""
    found: list[np.ndarray] = []

    async def inside() -> None:
        way = Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0"), **fiber)
        config = DispatcherConfig("", "", 1, {"alice": "", "bob": ""}, [way], [])
        source = PairSource(statistics="poisson", mean_pairs=mean)
        config.devices.update(alice=Device(source=source), bob=device)
        laboratory = Laboratory(config)
        request = AdjustFiberRequest(a="alice", b="bob", tapped=tapped)
        adjust(laboratory.layer, "runner", request)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(np.full(COUNT, state, np.uint8))
        await alice.send({(0, 0): "alice-q0"}, rate_hz)
        await bob.receive((0, 0), "bob-q0")
        await act(laboratory, bob)
        basis = state >> 1
        found.append(await bob.measure((0, 0), bases=np.full(COUNT, basis, np.uint8)))
        assert laboratory.layer.sabot.live_qubits == 0

    uvloop.run(inside())
    return found[0]


async def nothing(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Measure the light as it comes."""


async def waits(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Let it wait for half a second."""
    await bob.store((0, 0))
    await laboratory.wait(0.5)


async def turns(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Do an H and take it back by another."""
    await bob.apply((0, 0), gates=[Gate(name=Gate.H)] * 2)


async def keeps(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Do an X, which leaves |+> as it is but for the noise of gates."""
    await bob.apply((0, 0), np.ones(COUNT, np.uint8))


HALF = 0.5  # seconds
T = 1.0
TWO_GATES = 0.3 / 2 * (2 - 0.3)  # of two depolarisations by .3 one after the other
Act = Callable[[Laboratory, LaboratoryHost], Awaitable[None]]


@pytest.mark.parametrize(
    ("state", "act", "device", "fiber", "error"),
    [
        (PLUS, waits, Device(memory=Memory(t1_s=1e9, t2_s=T)), {}, (1 - exp(-HALF / T)) / 2),
        (PLUS, waits, Device(memory=Memory(depolarizing_s=T)), {}, (1 - exp(-HALF / T)) / 2),
        (ONE, waits, Device(memory=Memory(t1_s=T, t2_s=T)), {}, 1 - exp(-HALF / T)),
        (ONE, waits, Device(memory=Memory(t1_s=T, t2_s=2 * T)), {}, (1 - exp(-HALF / T)) / 2),
        (ONE, turns, Device(gates=Gates(one_qubit_depolarizing=0.3)), {}, TWO_GATES),
        (PLUS, keeps, Device(gates=Gates(one_qubit_depolarizing=0.3)), {}, 0.15),
        (ONE, waits, Device(memory=Memory(noise=FLIP)), {}, 0.25),
        (ONE, turns, Device(gates=Gates(noise=FLIP)), {}, 0.25),
        (ONE, nothing, Device(), {"noise": FLIP}, 0.25),
        (ONE, nothing, Device(), {"burst_depolarizing": 0.8, "burst_start_hz": 1e12}, 0.4),
    ],
    ids=[
        "T2",
        "depolarising",
        "T1",
        "twirl",
        "H",
        "Pauli",
        "own memory",
        "own gate",
        "own fibre",
        "burst",
    ],
)
def test_each_photon_of_a_weak_pulse_errs_by_itself(
    state: int, act: Act, device: Device, fiber: dict[str, Any], error: float
) -> None:
    """T1 = T2 is a reset to |0> alone; the twirl of T2 = 2 T1 is X and XZ with half of that."""
    if fiber.get("burst_start_hz"):
        fiber = fiber | {"burst_end_hz": 1e-6}  # it is bad all the time
    figures = weak_pulses(state, act, device, **fiber)
    seen = figures != NO_CLICK
    assert within(int(seen.sum()), COUNT, 1 - exp(-MEAN))
    assert within(int((figures[seen] != (state & 1)).sum()), int(seen.sum()), wrong(error))


def test_who_taps_a_fibre_measures_photon_by_photon() -> None:
    """Of a half of the photons, in Z or X, a quarter of all is wrong in Z: X with f/4."""
    figures = weak_pulses(ONE, nothing, Device(), tapped=1.0)
    seen = figures != NO_CLICK
    assert within(int((figures[seen] == 0).sum()), int(seen.sum()), wrong(0.25))


@pytest.mark.parametrize(
    ("device", "fiber"),
    [(Device(), {"noise": LOSE}), (Device(memory=Memory(noise=LOSE)), {})],
    ids=["fibre", "memory"],
)
def test_a_model_of_ones_own_loses_each_photon_by_itself(
    device: Device, fiber: dict[str, Any]
) -> None:
    figures = weak_pulses(ONE, waits, device, **fiber)
    assert within(int((figures != NO_CLICK).sum()), COUNT, 1 - exp(-MEAN / 2))


async def senses(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Let it take the phase of the sensor."""
    await bob.sense((0, 0))


def test_each_photon_of_a_weak_pulse_takes_the_phase_of_a_sensor() -> None:
    """Half a turn makes |-> of |+>, of all photons of a pulse."""
    figures = weak_pulses(PLUS, senses, Device(sensor=Sensor(pi)))
    seen = figures != NO_CLICK
    assert within(int(seen.sum()), COUNT, 1 - exp(-MEAN))
    assert (figures[seen] == 1).all()


async def stays(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Store it: it is read out as one when it is measured."""
    await bob.store((0, 0))


def test_each_photon_of_a_weak_pulse_relaxes_by_the_wait_of_its_pulse() -> None:
    """Pulses come one after the other in 2 s, and leave the memory at once: the first wait longest.

    Of tenths of them; within one, e is as good as linear.
    """
    mean, span_s = 0.5, 2.0
    memory = Memory(t1_s=T, t2_s=T)
    figures = weak_pulses(
        ONE, stays, Device(memory=memory), mean=mean, rate_hz=round(COUNT / span_s)
    )
    for tenth, bits in enumerate(figures.reshape(10, -1)):
        waited_s = span_s * (1 - (tenth + 0.5) / 10)
        seen = bits != NO_CLICK
        likely = wrong(1 - exp(-waited_s / T), mean)
        assert within(int((bits[seen] == 0).sum()), int(seen.sum()), likely)


def test_each_photon_of_a_weak_pulse_fades_by_the_wait_of_its_pulse() -> None:
    """Of a Poisson pulse that waited for t any is left with 1 - exp(-m exp(-t / retrieval))."""
    mean, span_s = 1.0, 2.0
    memory = Memory(retrieval_s=T)
    figures = weak_pulses(
        ONE, stays, Device(memory=memory), mean=mean, rate_hz=round(COUNT / span_s)
    )
    for tenth, bits in enumerate(figures.reshape(10, -1)):
        waited_s = span_s * (1 - (tenth + 0.5) / 10)
        likely = 1 - exp(-mean * exp(-waited_s / T))
        assert within(int((bits != NO_CLICK).sum()), bits.size, likely)


async def flips_some(laboratory: Laboratory, bob: LaboratoryHost) -> None:
    """Do an X to every third pulse."""
    await bob.apply((0, 0), np.array(np.arange(COUNT) % 3 == 0, np.uint8))


def test_a_pauli_of_one_pulse_meets_all_its_photons_and_no_others() -> None:
    figures = weak_pulses(ONE, flips_some, Device())
    expected = np.arange(COUNT) % 3 != 0
    assert (figures == expected)[figures != NO_CLICK].all()


def test_a_model_of_ones_own_has_each_photon_wait_as_its_pulse_does() -> None:
    """Of two seconds of pulses the first half has waited for more than one."""
    memory = Memory(noise=FLIP_OLD)
    figures = weak_pulses(ONE, stays, Device(memory=memory), rate_hz=COUNT // 2)
    expected = np.arange(COUNT) >= COUNT // 2
    about = np.abs(np.arange(COUNT) - COUNT // 2) < 10
    assert (figures == expected)[(figures != NO_CLICK) & ~about].all()
