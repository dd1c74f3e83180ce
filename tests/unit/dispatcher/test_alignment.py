"""Interference of light whose qubits are in time bins, by its polarisation; 5 sigma, seed 1."""

import asyncio
from math import cos, exp, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest
from five_sigma import within
from heralding_scene import SCHEMES, correlations, heralded, in_fock_space, scene
from numpy.typing import NDArray
from test_beam_splitter import TO_RELAY
from test_polarization import FAST, kept, matrix, quaternions

from dispatcher.approximations import LOSS_OF_POLARISATION, MODE_DISPERSION
from dispatcher.devices.heralding import Arm
from dispatcher.fiber.turn import Turn, alignment, gathered, merged, of_paulis
from dispatcher.layer.ownership import BlockName
from evidence.curves.link import configuration, fiber
from evidence.laboratory import Laboratory
from wire.dispatcher_pb2 import AttemptRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Detectors, Device, Emitter, PairSource

COUNT = 60_000
KINDS = ("complete", "linear", "beam-splitter")
SCRAMBLED = 4.5  # rad, rms: of a Stokes vector .0012 is left
# Gauss and Legendre's places and weights for x from 0 to 1.
PLACES, WEIGHTS = (each / 2 for each in np.polynomial.legendre.leggauss(12))


def drift(rms_rad: float, time_s: float = FAST) -> dict[str, Any]:
    """Return parameters of a kilometre of fibre."""
    return {
        "polarization_drift_rad_per_sqrt_km": rms_rad,
        "polarization_drift_time_s": time_s,
    }


def overlap_of(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return |<H|A* B|H>|^2 of two turns, by matrices."""
    return float(abs((matrix(one).conj().T @ matrix(other))[0, 0]) ** 2)


def test_alignment_is_the_overlap_of_turned_polarisations() -> None:
    a, b, c = (each / np.linalg.norm(each) for each in quaternions(3))
    one, other = Turn(np.array([0, 2]), np.array([a, b])), Turn(np.array([0]), np.array([c]))
    found = alignment(one, other, 4)
    np.testing.assert_allclose(found, [overlap_of(a, c)] * 2 + [overlap_of(b, c)] * 2)
    assert alignment(other, None, 4) == pytest.approx(overlap_of(c, np.array([1.0, 0, 0, 0])))
    assert alignment(None, None, 4) == alignment(one, one, 4) == 1.0


def test_turns_of_photons_are_merged_and_gathered_photon_by_photon() -> None:
    a, b, c = quaternions(3)
    still, photons = np.array([1.0, 0, 0, 0]), np.arange(5)
    one, other = Turn(np.array([0, 3]), np.array([a, b])), Turn(np.array([0]), np.array([c]))
    members = np.array([0, 1, 0, 0, 1], bool)
    whole = merged(one, other, members)
    assert whole is not None
    np.testing.assert_array_equal(whole.quaternions[whole.stretch(photons)], [a, c, a, b, c])
    part = merged(one, None, members)
    assert part is not None
    np.testing.assert_array_equal(part.quaternions[part.stretch(photons)], [a, still, a, b, still])
    taken = gathered([(one, np.array([4, 0], np.uint32)), (None, np.array([1], np.uint32))])
    assert taken is not None
    np.testing.assert_array_equal(taken.quaternions[taken.stretch(photons[:3])], [b, a, still])
    assert merged(None, None, members) is gathered([(None, photons.astype(np.uint32))]) is None


def test_turns_by_paulis_are_those_of_their_matrices() -> None:
    paulis = np.array([0, 1, 1, 2, 3, 0], np.uint8)
    turn = of_paulis(paulis)
    assert turn.starts.tolist() == [0, 1, 3, 4, 5]
    found = alignment(turn, None, paulis.size)
    np.testing.assert_array_equal(found, [1, 0, 0, 1, 0, 1])  # X and Y make V of H


def relay(kind: str, own: dict[str, Any], source: PairSource, **more: Any) -> Laboratory:
    """Return a network in which light of alice meets light of bob at charlie, in time bins."""
    host = Device(source, detectors=Detectors(encoding="time-bin"))
    relay = Device(detectors=host.detectors, analyser=BellAnalyser(kind, **more))
    fibers = [fiber(*way, length_km=1.0, **own.get(way[0][0], {})) for way in TO_RELAY]
    return Laboratory(configuration(1, fibers, {"alice": host, "bob": host, "charlie": relay}))


async def swapped(laboratory: Laboratory, stored: bool = False) -> tuple[int, int, int]:
    """Swap pairs; return how many are in a wrong phase in X, of how many, and wrong in Z."""
    alice, bob, charlie = (laboratory.host(name) for name in ("alice", "bob", "charlie"))
    for number, (host, way) in enumerate(zip((alice, bob), TO_RELAY, strict=True)):
        await host.create(COUNT, number)
        await host.send({(number, 1): way[0]})
        await charlie.receive((number, 1), way[1])
        if stored:
            await charlie.store((number, 1))
    outcomes = await charlie.bell_measure((0, 1), (1, 1))
    bases = np.arange(COUNT, dtype=np.uint8) % 2
    ends = [await alice.measure((0, 0), bases=bases), await bob.measure((1, 0), bases=bases)]
    seen = (outcomes != NO_CLICK) & (outcomes & 1 == 1)  # Psi, which every kind reports
    wrong = (ends[0] ^ ends[1] ^ (outcomes >> bases)) & 1
    in_x = seen & (bases == 1)
    return int(wrong[in_x].sum()), int(in_x.sum()), int(wrong[seen & (bases == 0)].sum())


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rms_rad", [0.8, SCRAMBLED])
def test_time_bins_behind_fibres_that_turn_polarisation_swap_worse(
    kind: str, rms_rad: float
) -> None:
    """V = (1 + c c') / 2 on average, of which each fibre leaves c; of nothing left F = .75."""
    source = PairSource(encoding="time-bin")
    laboratory = relay(kind, dict.fromkeys("ab", drift(rms_rad)), source)
    wrong, pairs, in_z = asyncio.run(swapped(laboratory))
    assert within(wrong, pairs, (1 - (1 + kept(rms_rad) ** 2) / 2) / 2)
    assert in_z == 0
    assert laboratory.layer.approximations.sizes == {}  # exactly


@pytest.mark.parametrize("stored", [False, True])
def test_one_turn_of_all_photons_is_met_by_all(stored: bool) -> None:
    """V = |<H|T|H>|^2 of the turn that was drawn for the whole block; a memory keeps it."""
    laboratory = relay("complete", {"a": drift(SCRAMBLED, 1e9)}, PairSource(encoding="time-bin"))
    found = []

    async def act() -> tuple[int, int, int]:
        measure = laboratory.layer.ownership.require

        def seen(name: BlockName, node: str) -> Any:
            block = measure(name, node)
            if block.pulses.polarization is not None:
                found.append(block.pulses.polarization)
            return block

        laboratory.layer.ownership.require = seen  # type: ignore[method-assign]
        return await swapped(laboratory, stored)

    wrong, pairs, _in_z = asyncio.run(act())
    (turn,) = found[-1].quaternions
    assert 0.05 < overlap_of(turn, np.array([1.0, 0, 0, 0])) < 0.95
    assert within(wrong, pairs, (1 - overlap_of(turn, np.array([1.0, 0, 0, 0]))) / 2)


def test_loss_by_polarisation_loses_light_in_time_bins_and_turns_the_rest() -> None:
    """(1 + t^2) / 2 come; V is the mean of |a + b n_z|^2, which is 1 - 2 b^2 / 3(a^2 + b^2)."""
    t = 10 ** (-20 / 20)
    a, b = (1 + t) / 2, (1 - t) / 2
    laboratory = relay("complete", {"a": {"pdl_db": 20.0}}, PairSource(encoding="time-bin"))
    wrong, pairs, _in_z = asyncio.run(swapped(laboratory))
    assert within(2 * pairs, COUNT // 2, (1 + t**2) / 2)  # half of all outcomes are Psi
    visibility = (a**2 + b**2 / 3) / (a**2 + b**2)
    assert within(wrong, pairs, (1 - visibility) / 2)
    assert set(laboratory.layer.approximations.sizes) == {LOSS_OF_POLARISATION}


def test_mode_dispersion_takes_light_in_time_bins_apart() -> None:
    """The mean of exp(-(s d / 2)^2) over Maxwell's d of mean D: (1 + pi s^2 D^2 / 16)^(-3/2)."""
    mean_ps, width_nm = 10.0, 0.1
    s = 2 * pi * 193.4e12**2 / 299_792_458 * width_nm * 1e-9
    own = {"a": {"pmd_ps_per_sqrt_km": mean_ps, "polarization_drift_time_s": FAST}}
    source = PairSource(encoding="time-bin", bandwidth_nm=width_nm)
    laboratory = relay("complete", own, source)
    wrong, pairs, _in_z = asyncio.run(swapped(laboratory))
    visibility = (1 + pi * (s * mean_ps * 1e-12) ** 2 / 16) ** -1.5
    assert within(wrong, pairs, (1 - visibility) / 2)
    assert set(laboratory.layer.approximations.sizes) == {MODE_DISPERSION}


def lasers(a: float, b: float, angle_rad: float) -> dict[int, float]:
    """Return how often |++> of two lasers tells Psi+ and Psi-, the second turned by an angle.

    The mean over the phase between both: detectors of the four modes stay dark with exp(-n), n the
    light there. Of the second laser cos^2 of it interferes, and the rest is by itself.
    """
    chances = {1: 0.0, 3: 0.0}
    for phase in np.arange(64) * 2 * pi / 64:
        light = []
        for sign in (1, -1):
            alike = abs(sqrt(a) + sign * np.exp(1j * phase) * sqrt(b) * cos(angle_rad)) ** 2
            light.append((alike + b * sin(angle_rad) ** 2) / 4)  # in either of H and V
        (c, d), dark = (1 - np.exp(-np.array(light))), np.exp(-np.array(light))
        chances[1] += ((c * dark[1]) ** 2 + (d * dark[0]) ** 2) / 64
        chances[3] += 2 * c * d * dark[0] * dark[1] / 64
    return chances


@pytest.mark.parametrize("angle_rad", [0.0, 0.6, pi / 2])
def test_weak_pulses_meet_by_their_polarisation_however_many_photons_they_have(
    angle_rad: float,
) -> None:
    """Against the mean over phases of classical light in two polarisations."""
    source = PairSource("poisson", 0.6, encoding="time-bin")
    laboratory = relay("beam-splitter", {}, source)
    charlie = laboratory.host("charlie")

    async def act() -> NDArray[np.uint8]:
        for number, (host, way) in enumerate(zip(("alice", "bob"), TO_RELAY, strict=True)):
            await laboratory.host(host).prepare(np.full(COUNT, 2, np.uint8), number)
            await laboratory.host(host).send({(number, 0): way[0]})
            await charlie.receive((number, 0), way[1])
        (block,) = laboratory.layer.ownership.parts(BlockName(1, 1, 0))
        turned = np.array([[cos(angle_rad), sin(angle_rad), 0.0, 0.0]])
        block.pulses.polarization = Turn(np.zeros(1, np.int64), turned)
        return await charlie.bell_measure((0, 0), (1, 0))

    outcomes = asyncio.run(act())
    for state, chance in lasers(0.6, 0.6, angle_rad).items():
        assert within(int(np.count_nonzero(outcomes == state)), COUNT, chance)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("scheme", list(SCHEMES))
@pytest.mark.parametrize("efficiency", [0.05, 0.8])
def test_heralds_of_scrambled_light_are_the_mean_over_its_overlap(
    scheme: str, efficiency: float
) -> None:
    """Of any two polarisations it is evenly between 0 and 1: Fock space, summed over it."""
    alpha, best, count = 0.3, 0.9, 30_000
    device = Device(
        PairSource(encoding="time-bin"), emitter=Emitter(scheme, efficiency, alpha, modes=100)
    )
    arms = (Arm(efficiency, alpha),) * 2
    state, phases = np.zeros((4, 4), complex), np.diag([1, 1, -1, -1])
    for place, weight in zip(PLACES + 0.5, WEIGHTS, strict=True):
        states = in_fock_space(scheme, arms, 0.0, best * place**2)  # even in x^2, of weight 2 x
        state += 2 * place * weight * (states[1] + phases @ states[3] @ phases)
    chance = np.trace(state).real
    state /= chance

    async def act(laboratory: Laboratory) -> None:
        reported, attempts, _took_s = await heralded(laboratory, count)
        assert within(count, attempts, chance)
        right = await correlations(laboratory, reported)
        assert within(*right["Z"], (state[1, 1] + state[2, 2]).real)
        assert within(*right["X"], (1 + 2 * (state[1, 2] + state[0, 3]).real) / 2)
        assert within(*right["Y"], (1 + 2 * (state[1, 2] - state[0, 3]).real) / 2)
        assert laboratory.layer.exact

    bins = Detectors(encoding="time-bin")
    station = Device(detectors=bins, analyser=BellAnalyser("linear", visibility=best))
    scene(act, device, station, **drift(SCRAMBLED / sqrt(10.0)))


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_light_of_two_colours_heralds_pairs_with_less_of_a_phase(scheme: str) -> None:
    """V = exp(-(d / 2s)^2) in Fock space, d 12.5 GHz apart."""
    width_nm, apart_mhz, alpha, efficiency, count = 0.1, 12_500, 0.2, 0.5, 60_000
    s = 2 * pi * 193.4e12**2 / 299_792_458 * width_nm * 1e-9
    visibility = exp(-((2e6 * pi * apart_mhz / (2 * s)) ** 2))
    states = in_fock_space(scheme, (Arm(efficiency, alpha),) * 2, 0.0, visibility)
    phases = np.diag([1, 1, -1, -1])
    state = states[1] + phases @ states[3] @ phases
    chance = np.trace(state).real
    device = Device(
        PairSource(bandwidth_nm=width_nm), emitter=Emitter(scheme, efficiency, alpha, modes=100)
    )

    async def act(laboratory: Laboratory) -> None:
        row = laboratory.table.rows["attempt"]

        def other(node: str, request: AttemptRequest) -> Any:
            request.frequency_mhz = 193_400_000 + apart_mhz * (node == "bob")
            return row.handler(node, request)

        laboratory.table.rows["attempt"] = row._replace(handler=other)
        found, attempts, _took_s = await heralded(laboratory, count)
        assert within(count, attempts, chance)
        right = await correlations(laboratory, found)
        assert within(*right["X"], (1 + 2 * (state[1, 2] + state[0, 3]).real / chance) / 2)

    scene(act, device)


def test_mode_dispersion_takes_single_clicks_apart() -> None:
    """The phase is kept by the mean of exp(-(s d)^2 / 8) over Maxwell's d: amplitudes overlap."""
    alpha, mean_ps, width_nm, count = 0.1, 10.0, 0.2, 60_000
    s = 2 * pi * 193.4e12**2 / 299_792_458 * width_nm * 1e-9
    amplitude = (1 + pi * (s * mean_ps * 1e-12) ** 2 / 32) ** -1.5
    source = PairSource(bandwidth_nm=width_nm)
    device = Device(source, emitter=Emitter("single-click", 0.001, alpha, modes=1000))
    own = {"pmd_ps_per_sqrt_km": mean_ps / sqrt(10.0), "polarization_drift_time_s": FAST}

    async def act(laboratory: Laboratory) -> None:
        reported, _attempts, _took_s = await heralded(laboratory, count)
        right = await correlations(laboratory, reported)
        assert within(*right["X"], (1 + (1 - alpha) * amplitude) / 2)
        assert set(laboratory.layer.approximations.sizes) == {MODE_DISPERSION}

    scene(act, device, own={"alice": own})
    assert exp(-1) < amplitude < 0.9
