"""Light of two arms at a beam splitter against closed forms; 5 sigma, the seed is 1."""

import asyncio
from dataclasses import replace
from itertools import product
from math import factorial

import numpy as np
import pytest
from five_sigma import within

from dispatcher.devices.overlap import AMPLITUDES, outputs
from dispatcher.layer.ownership import BlockName
from evidence.curves.link import configuration, fiber
from evidence.curves.relay_theory import clicks, diagonal, rectilinear
from evidence.laboratory import SESSION, Laboratory
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Detectors, Device, PairSource

COUNT = 100_000
PSI = {"Psi+": 1, "Psi-": 3}
TO_RELAY = ("alice-q0", "charlie-q0"), ("bob-q0", "charlie-q1")
LOSS_DB = 3.0
ARRIVES = 10 ** (-LOSS_DB / 10)
DARK = 1e-3


async def meet(
    sources: tuple[PairSource, PairSource],
    states: tuple[np.ndarray, np.ndarray],
    detectors: Detectors = Detectors(),  # noqa: B008 - frozen
    backend: str = "chp",
    **analyser: float,
) -> tuple[np.ndarray, Laboratory]:
    """Let pulses of alice and bob meet at charlie; return what he tells."""
    lossy = [fiber(*way, length_km=10.0, loss_db_per_km=LOSS_DB / 10) for way in TO_RELAY]
    ends = {host: Device(source) for host, source in zip(("alice", "bob"), sources, strict=True)}
    ends["charlie"] = Device(
        detectors=detectors, analyser=BellAnalyser("beam-splitter", **analyser)
    )
    config = configuration(1, lossy, ends)
    laboratory = Laboratory(replace(config, backend=backend))
    charlie = laboratory.host("charlie")
    for number, (own, way) in enumerate(zip(states, TO_RELAY, strict=True)):
        host = laboratory.host(("alice", "bob")[number])
        await host.prepare(own, number)
        await host.send({(number, 0): way[0]})
        await charlie.receive((number, 0), way[1])
    return await charlie.bell_measure((0, 0), (1, 0)), laboratory


def constant(one: int, other: int) -> tuple[np.ndarray, np.ndarray]:
    return np.full(COUNT, one, np.uint8), np.full(COUNT, other, np.uint8)


def amplitudes(number: int, mean: float) -> np.ndarray:
    return np.array([each * mean**0.5 for each in AMPLITUDES[number]], complex)


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize(("one", "other"), list(product(range(6), repeat=2)))
def test_photons_leave_as_the_mean_over_the_phases_of_lasers_says(one: int, other: int) -> None:
    """Poisson pulses of a mean are the mean over phases: no number of photons is known there."""
    means, report = (0.3, 0.2), dict.fromkeys(PSI, 0.0)
    for n, m in product(range(6), repeat=2):
        if n + m == 0:
            continue
        weight = np.exp(-sum(means)) * means[0] ** n * means[1] ** m / factorial(n) / factorial(m)
        photons, chances = outputs((one,) * n, (other,) * m)
        lit = (photons > 0).astype(int) @ [1, 2, 4, 8]
        report["Psi+"] += weight * chances[np.isin(lit, (0b0011, 0b1100))].sum()
        report["Psi-"] += weight * chances[np.isin(lit, (0b1001, 0b0110))].sum()
    theory = clicks(amplitudes(one, means[0]), amplitudes(other, means[1]), 0.0)
    assert report == pytest.approx(theory, abs=2e-4)  # seven photons are rarer


@pytest.mark.parametrize(("one", "other"), [(0, 0), (0, 1), (1, 3), (2, 2), (2, 3), (4, 5), (3, 4)])
def test_weak_pulses_of_lasers_are_told_of_as_often_as_those_of_known_phases(
    one: int, other: int
) -> None:
    lasers = PairSource("poisson", 0.8), PairSource("poisson", 0.5)
    detectors = Detectors(0.9, DARK / 1e-9)
    outcomes, laboratory = asyncio.run(meet(lasers, constant(one, other), detectors))
    seen = ARRIVES * 0.9
    dark = -np.expm1(-DARK)
    theory = clicks(amplitudes(one, 0.8 * seen), amplitudes(other, 0.5 * seen), dark)
    for name, number in PSI.items():
        assert within(int(np.count_nonzero(outcomes == number)), COUNT, theory[name]), name
    assert set(np.unique(outcomes)) <= {*PSI.values(), NO_CLICK}
    assert laboratory.layer.exact
    assert laboratory.layer.sabot.live_bytes == 0


@pytest.mark.parametrize(("a", "b"), [(0.2, 0.2), (0.4, 0.1)])
def test_published_closed_forms_are_that_mean(a: float, b: float) -> None:
    """Ma and Razavi's of both bases, with an error of 2 %; bits fit in Z if they are unlike."""
    for formula, states in ((rectilinear, (0, 1)), (diagonal, (2, 3))):
        gain = wrong = 0.0
        for one, other in product(states, repeat=2):
            report = clicks(amplitudes(one, a), amplitudes(other, b), 1e-3)
            differs = {"Psi+": (one != other) == (formula is rectilinear), "Psi-": one != other}
            for name, chance in report.items():
                gain += chance / 4
                wrong += chance / 4 * (0.98 if not differs[name] else 0.02)
        assert formula(a, b, 1e-3, 0.02) == pytest.approx((gain, wrong), rel=1e-9)


@pytest.mark.parametrize("visibility", [1.0, 0.6])
def test_equal_photons_of_unequal_time_or_colour_tell_psi_minus(visibility: float) -> None:
    """|++> is half Psi+ and half Phi+; distinguishable photons go where they like."""
    single = PairSource(), PairSource()
    outcomes, _ = asyncio.run(meet(single, constant(2, 2), visibility=visibility))
    both = ARRIVES**2
    minus = both * (1 - visibility) / 4
    assert within(int(np.count_nonzero(outcomes == 3)), COUNT, minus)
    assert within(int(np.count_nonzero(outcomes == 1)), COUNT, both * visibility / 2 + minus)


def test_an_output_that_is_told_wrongly_makes_psi_minus_of_psi_plus() -> None:
    """|++> is read as Psi+ alone; with an error e of either detector as Psi- with 2 e (1 - e)."""
    error = 0.05
    single = PairSource(), PairSource()
    detectors = Detectors(readout_error=error)
    outcomes, _ = asyncio.run(meet(single, constant(2, 2), detectors))
    count = int(np.count_nonzero(outcomes != NO_CLICK))
    assert within(count, COUNT, ARRIVES**2 / 2)
    assert within(int(np.count_nonzero(outcomes == 3)), count, 2 * error * (1 - error))


@pytest.mark.parametrize("extras", [(2, 0), (0, 2), (1, 1)])
def test_noise_of_either_arm_clicks(extras: tuple[int, int]) -> None:
    """Two photons without a state: in unlike polarisations with 1/2, by one output with 1/2."""
    devices = {"charlie": Device(analyser=BellAnalyser("beam-splitter"))}
    laboratory = Laboratory(configuration(1, [], devices))
    layer, charlie = laboratory.layer, laboratory.host("charlie")

    async def run() -> np.ndarray:
        for number, each in enumerate(extras):
            await charlie.prepare(np.zeros(COUNT, np.uint8), number)
            (part,) = layer.ownership.parts(BlockName(SESSION, number, 0))
            layer.sabot.lose(part.register, np.ones(COUNT, np.bool_))
            if each:
                part.pulses.extras = np.full(COUNT, each, np.uint8)
        return await charlie.bell_measure((0, 0), (1, 0))

    outcomes = asyncio.run(run())
    for state in PSI.values():
        assert within(int(np.count_nonzero(outcomes == state)), COUNT, 0.25)


def test_pulses_of_unlike_photons_mark_the_result() -> None:
    lasers = {host: Device(PairSource("poisson", 2.0)) for host in ("alice", "bob")}
    lasers["charlie"] = Device(analyser=BellAnalyser("beam-splitter"))
    fibers = [fiber(*way, depolarizing=0.2) for way in TO_RELAY]
    laboratory = Laboratory(configuration(1, fibers, lasers))

    async def run() -> None:
        for number, way in enumerate(TO_RELAY):
            host = laboratory.host(("alice", "bob")[number])
            await host.prepare(np.zeros(1000, np.uint8), number)
            await host.send({(number, 0): way[0]})
            await laboratory.host("charlie").receive((number, 0), way[1])
        await laboratory.host("charlie").bell_measure((0, 0), (1, 0))

    asyncio.run(run())
    assert not laboratory.layer.exact


def test_halves_of_pairs_are_swapped_where_psi_is_told() -> None:
    """Half of the pairs; the rest at both ends is in the heralded Bell state."""
    relay = {"charlie": Device(analyser=BellAnalyser("beam-splitter"))}
    laboratory = Laboratory(configuration(1, [fiber(*way) for way in TO_RELAY], relay))
    alice, bob, charlie = (laboratory.host(name) for name in ("alice", "bob", "charlie"))

    async def run() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        for number, (host, way) in enumerate(zip((alice, bob), TO_RELAY, strict=True)):
            await host.create(COUNT, number)
            await host.send({(number, 1): way[0]})
            await charlie.receive((number, 1), way[1])
        report = await charlie.bell_measure((0, 1), (1, 1))
        bases = np.arange(COUNT, dtype=np.uint8) % 2
        ends = [await alice.measure((0, 0), bases=bases), await bob.measure((1, 0), bases=bases)]
        return report, bases, ends[0] ^ ends[1]

    report, bases, differ = asyncio.run(run())
    seen = report != NO_CLICK
    assert within(int(np.count_nonzero(seen)), COUNT, 0.5)
    assert within(int(np.count_nonzero(report == 1)), COUNT, 0.25)
    assert np.array_equal(differ[seen], (report >> bases & 1)[seen])


def test_state_vectors_tell_the_same_states_as_stabilisers() -> None:
    lasers = PairSource("poisson", 1.0), PairSource("poisson", 1.0)
    places = np.arange(2000)
    states = (places % 6).astype(np.uint8), (places // 6 % 6).astype(np.uint8)
    by_stabilisers, _ = asyncio.run(meet(lasers, states, backend="chp"))
    by_vectors, _ = asyncio.run(meet(lasers, states, backend="dense"))
    assert np.array_equal(by_stabilisers, by_vectors)
