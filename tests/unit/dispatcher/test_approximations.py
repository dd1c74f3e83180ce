"""Sizes of approximations, held against the differences of density matrices themselves."""

from itertools import product
from math import exp, log10
from pathlib import Path

import numpy as np
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, block, configuration, running
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.approximations import (
    CROWD,
    EXACT,
    RELAXATION,
    SEVERAL_PAIRS,
    STIMULATED,
    TURN,
    UNEQUAL_ARMS,
    approximation,
    of_outcomes,
    twirled_phase,
    twirled_turn,
)
from dispatcher.devices.heralding import Arm, single_click
from dispatcher.devices.source import emit
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.draws import Draws
from evidence.laboratory import Laboratory, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import CreateRequest, Gate, StoreRequest
from wire.parameters.physics import Device, Memory, PairSource

Matrix = NDArray[np.complex128]
PAULIS: list[Matrix] = [
    np.eye(2, dtype=np.complex128),
    np.array([[0, 1], [1, 0]], dtype=np.complex128),
    np.array([[0, -1j], [1j, 0]], dtype=np.complex128),
    np.array([[1, 0], [0, -1]], dtype=np.complex128),
]


def furthest(quaternion: NDArray[np.float64]) -> float:
    """Return the largest trace distance of a turned state from that which its Paulis make."""
    turn = sum(
        (part * (1 if not n else -1j) * PAULIS[n] for n, part in enumerate(quaternion)),
        np.zeros((2, 2), np.complex128),
    )
    most = 0.0
    for theta in np.linspace(0, np.pi, 41):
        for phi in np.linspace(0, 2 * np.pi, 81):
            state = np.array([np.cos(theta / 2), np.exp(1j * phi) * np.sin(theta / 2)])
            pure = np.outer(state, state.conj())
            mixed = sum(
                part**2 * pauli @ pure @ pauli.conj().T
                for part, pauli in zip(quaternion, PAULIS, strict=True)
            )
            apart = np.linalg.eigvalsh(turn @ pure @ turn.conj().T - mixed)
            most = max(most, float(np.abs(apart).sum()) / 2)
    return most


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("angle_rad", [0.1, 0.4, 1.2, np.pi / 2])
def test_flips_for_a_phase_are_wrong_by_half_the_sine_of_its_angle(angle_rad: float) -> None:
    turned = np.array([np.cos(angle_rad / 2), 0, 0, np.sin(angle_rad / 2)])
    ((_name, size),) = twirled_phase(angle_rad).sizes.items()
    assert size == pytest.approx(furthest(turned), rel=2e-3)


@pytest.mark.nightly
def test_no_state_is_extra_pairs_from_its_twirled_turn_than_is_said() -> None:
    generator = np.random.default_rng(1)
    for _ in range(12):
        turned = generator.standard_normal(4)
        turned /= np.linalg.norm(turned)
        size = twirled_turn(turned[None]).sizes[TURN]
        assert size is not None
        assert furthest(turned) <= size <= 0.75


def test_the_largest_of_a_kind_is_kept() -> None:
    small, large = (approximation("it", most) for most in (0.1, 0.2))
    assert (small | large | EXACT | small).sizes == {"it": 0.2}


def test_relaxation_by_paulis_is_wrong_by_half_of_what_has_relaxed(tmp_path: Path) -> None:
    """|1> after .3 T1 is |1> with e^-.3, twirled with (1 + e^-.3) / 2: half of what has relaxed."""

    async def inside() -> None:
        clock = JumpingClock()
        device = Device(memory=Memory(t1_s=1.0, t2_s=2.0))
        config = configuration(tmp_path, devices={"alice": device})
        async with running(config, clock) as bench:
            await wait_and_measure(bench, clock)
            status = await bench.runner.status()
            (met,) = status.approximations
            assert met.name == RELAXATION
            assert met.most == pytest.approx((1 - np.exp(-0.3)) / 2)

    uvloop.run(inside())


async def wait_and_measure(bench: Bench, clock: JumpingClock) -> None:
    await bench.alice.create(10, state=CreateRequest.ZEROS)
    await bench.alice.act(StoreRequest(block=block(0)))
    clock.time_ns += 3 * 10**8
    await bench.alice.measure(block(0))


@pytest.mark.parametrize("mean", [0.1, 0.5])
def test_thermal_pairs_stimulate_each_other_where_there_are_several(mean: float) -> None:
    """P(n) = m^n / (1 + m)^(n + 1): of the pulses with light, how many have two pairs or more."""
    chances = mean ** np.arange(200.0) / (1 + mean) ** np.arange(1.0, 201.0)
    random = PhotonRandom(Draws(1), (7, 0, 0), "here", 100)
    for statistics, expected in (
        ("thermal", chances[2:].sum() / chances[1:].sum()),
        ("poisson", 0),
    ):
        sizes = emit(PairSource(statistics, mean), random).approximations.sizes
        assert sizes.get(STIMULATED, 0) == pytest.approx(expected)


def test_several_photons_of_a_pulse_pass_no_gate_of_two_qubits() -> None:
    """Poisson pulses, mean .5: 1 - 1.5 e^-.5 have several pairs."""
    count = 40_000
    several = 1 - 1.5 * float(np.exp(-0.5))

    async def inside() -> None:
        device = Device(source=PairSource("poisson", 0.5))
        config = DispatcherConfig("", "", 1, {"alice": ""}, [], [], devices={"alice": device})
        laboratory = Laboratory(config)
        alice, target = laboratory.host("alice"), block_id((0, 1))
        await alice.create(count)
        await alice.apply((0, 0), gates=[Gate(name=Gate.CX, target=target)])
        await alice.measure((0, 0))
        (size,) = laboratory.layer.approximations.sizes.values()
        lit = -np.expm1(-0.5) * count
        assert within(size * lit, lit, several / -np.expm1(-0.5))

    uvloop.run(inside())


@pytest.mark.parametrize("passes", [1.0, 0.3])
def test_several_pairs_are_a_share_of_what_a_bell_measurement_tells(passes: float) -> None:
    """Of Poisson pulses, mean .5, whose photons come through each by chance.

    A share s of pairs has a photon left. Wrong are pulses with two of these or more; right are
    others that tell an outcome, which is both photons of the only pair.
    """
    count, left = 200_000, 1 - (1 - passes) ** 2
    only = exp(-0.5 * left)
    wrong, right = 1 - only * (1 + 0.5 * left), only * 0.5 * passes**2

    async def inside() -> None:
        device = Device(source=PairSource("poisson", 0.5))
        fibers = [
            Fiber(FiberEnd("alice", f"alice-q{n}"), FiberEnd("bob", f"bob-q{n}"), connectors_db=db)
            for n, db in enumerate([-10 * log10(passes)] * 2)
        ]
        tokens = {"alice": "", "bob": ""}
        config = DispatcherConfig("", "", 1, tokens, fibers, [], devices={"alice": device})
        laboratory = Laboratory(config)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.create(count)
        await alice.send({(0, half): f"alice-q{half}" for half in (0, 1)})
        for half in (0, 1):
            await bob.receive((0, half), f"bob-q{half}")
        await bob.bell_measure((0, 0), (0, 1))
        size = laboratory.layer.approximations.sizes[SEVERAL_PAIRS]
        among = count * (wrong + right)
        assert within(size * among, round(among), wrong / (wrong + right))

    uvloop.run(inside())


def test_what_is_wrong_of_outcomes_bounds_every_share_of_them() -> None:
    """All ways in which 3 wrong pulses can turn out, beside 4 right ones that are announced."""
    reports = np.array([1, 1, 1, 1, 1, 0, 0, 0], dtype=bool)
    wrong = np.array([0, 0, 0, 0, 1, 1, 1, 0], dtype=bool)
    (most,) = of_outcomes(CROWD, wrong, reports).sizes.values()
    assert most == 3 / 7
    ways = list(product((0, 1, None), repeat=3))
    for others in range(5):
        shares = [
            (others + sum(bit or 0 for bit in way)) / (4 + sum(bit is not None for bit in way))
            for way in ways
        ]
        assert max(shares) - min(shares) <= most + 1e-12
    assert of_outcomes(CROWD, np.zeros(8, bool), reports) is EXACT


def test_unequal_arms_herald_a_qubit_that_is_rather_in_one_state() -> None:
    """sqrt(.8) |01> + sqrt(.2) |10>: either qubit is .3 away from one half."""
    arms = Arm(0.4, 0.01), Arm(0.1, 0.01)
    assert single_click(arms, 0.0, 1.0).unequal == pytest.approx(0.3)
    assert single_click((arms[0], arms[0]), 0.0, 1.0).unequal == 0
    assert approximation(UNEQUAL_ARMS, 0.3)
