"""Kraus operators on state vectors against density matrices; 5 sigma, seed 1."""

from collections.abc import Awaitable, Callable
from itertools import product
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvloop
from channels_of_qubits import (
    ONE,
    Matrix,
    X,
    Y,
    Z,
    bell_outcomes,
    damping,
    outcomes,
    pair,
    some_channel,
    through,
)
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.kraus import MOST_OPERATORS, wrong_with
from dispatcher.sabot.manager import Sabot
from evidence.laboratory import Laboratory
from wire.config import BadConfig, DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import CreateRequest, Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Detectors, Device, Gates, Memory, PairSource

COUNT = 4_000
PREPARED_ONE = 1  # of dispatcher.operations.emission.STATES
RELAXING = str(Path(__file__).parents[3] / "docs" / "noise-models" / "damping.py") + ":Relaxing"
MODEL = """
from dataclasses import dataclass
from typing import Any
import numpy as np
from dispatcher.fiber.noise import Effect
from dispatcher.fiber.turn import Turn

@dataclass(frozen=True)
class Channel:
    kraus: Any = None
    pauli: int = 0
    angle: float = 0.0
    turn: Any = None
    only: str = ""

    def effect(self, moment):
        if self.only and self.only != f"{moment.what} {moment.qubits}":
            return Effect()
        everyone = np.ones(moment.photons)
        turn = None
        if self.turn is not None:
            turn = Turn(np.zeros(1, np.int64), np.array([self.turn]))
        return Effect(
            paulis=(everyone * self.pauli).astype(np.uint8) if self.pauli else None,
            angles_rad=everyone * self.angle if self.angle else None,
            turn=turn,
            kraus=self.kraus,
        )
"""

Outcomes = NDArray[np.uint8]


@pytest.fixture
def model(tmp_path: Path) -> str:
    """Return a noise model whose answers are its parameters."""
    (tmp_path / "models.py").write_text(MODEL)
    return f"{tmp_path / 'models.py'}:Channel"


def require(found: Outcomes, expected: list[float]) -> None:
    """Hold outcomes 0 to 3 against how likely they are."""
    assert sum(expected) == pytest.approx(1)
    counts = np.bincount(found, minlength=4)
    assert counts.sum() == found.size
    for count, likely in zip(counts, expected, strict=True):
        assert within(int(count), found.size, min(max(likely, 0.0), 1.0)), (counts, expected)


def both(first: Outcomes, second: Outcomes) -> Outcomes:
    """Return outcomes of both halves as one number."""
    return (2 * first + second).astype(np.uint8)


def act(
    run: Callable[[Laboratory], Awaitable[None]],
    alice: Device | None = None,
    backend: str = "dense",
    fibers: tuple[dict[str, Any], dict[str, Any]] = ({}, {}),
    rotation: int = 0,
) -> None:
    """Let something happen at alice and bob, whom two fibres and a switch that rotates join."""

    async def inside() -> None:
        ends = [("alice", "alice-q0", "1"), ("bob", "bob-q0", "2")]
        laid = [
            Fiber(FiberEnd(host, port), FiberEnd("q1", number), **own)
            for (host, port, number), own in zip(ends, fibers, strict=True)
        ]
        devices = {"alice": alice or Device(), "bob": Device()}
        switches = [QuantumSwitch("q1", rotation=rotation)]
        network = "", "", 1, dict.fromkeys(devices, ""), laid, switches
        await run(Laboratory(DispatcherConfig(*network, devices=devices, backend=backend)))

    uvloop.run(inside())


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("bases", list(product(range(5), repeat=2)))
def test_channels_on_both_halves_of_pairs_are_exact(bases: tuple[int, int]) -> None:
    """Two channels without any symmetry, one after the other, in each pair of bases."""
    sabot, draws = Sabot(Dense), Draws(1)
    registers, state = sabot.bell_pairs(COUNT), pair()
    everyone = np.ones(COUNT, dtype=bool)
    for half, operators in ((1, 3), (0, 2), (1, 4)):
        channel = some_channel(operators, operators)
        photons = draws.photons((7, 0, half), f"channel {operators}", COUNT)
        sabot.kraus(registers[half], channel, everyone, photons)
        state = through(state, half, channel)
    found = [
        sabot.measure(
            register,
            np.full(COUNT, bases[half], np.uint8),
            draws.photons((7, 0, half), "measure", COUNT),
        )
        for half, register in enumerate(registers)
    ]
    require(both(found[0], found[1]), outcomes(state, bases))


def test_only_those_qubits_meet_it_that_are_meant_each_its_own() -> None:
    """Damped wholly, by .3, or not at all: by qubit, and not by where that is in its state."""
    count = 3 * COUNT
    sabot, draws = Sabot(Dense), Draws(1)
    register = sabot.zeros(count)
    sabot.unite(register, sabot.part(register, np.arange(count) % 2 == 0))
    assert len(register.shares) == 2
    sabot.pauli(register, np.ones(count, np.uint8))
    operators = np.array([damping(gamma) for gamma in np.tile([1.0, 0.3, 1.0], COUNT)])
    met = np.tile([True, True, False], COUNT)
    sabot.kraus(register, operators, met, draws.photons((7, 0, 0), "channel", count))
    bits = sabot.measure(
        register, np.zeros(count, np.uint8), draws.photons((7, 0, 0), "measure", count)
    ).reshape(COUNT, 3)
    assert not bits[:, 0].any()
    assert within(int(bits[:, 1].sum()), COUNT, 0.7)
    assert bits[:, 2].all()


@pytest.mark.parametrize("backend", ["chp", "stim"])
def test_other_backends_refuse_them_and_say_which_to_take(model: str, backend: str) -> None:
    own = {"noise": model, "noise_parameters": {"kraus": damping(0.3).tolist()}}
    words = f"Kraus operators of noise at alice need .* {backend}: start with --backend dense"

    async def create(laboratory: Laboratory) -> None:
        with pytest.raises(BadConfig, match=words):
            await laboratory.host("alice").create(10)

    act(create, Device(source=PairSource(**own)), backend)  # type: ignore[arg-type]

    async def send(laboratory: Laboratory) -> None:
        await laboratory.host("alice").create(10)
        await laboratory.connect("q1", {1: 2})
        with pytest.raises(
            BadConfig, match=r"noise in the fibre to 1 of q1 need .* --backend dense"
        ):
            await laboratory.host("alice").send({(0, 1): "alice-q0"})

    act(send, None, backend, (own, {}))
    sabot, draws = Sabot(BACKENDS[backend]), Draws(1).photons((7, 0, 0), "channel", 1)
    register = sabot.zeros(1)
    with pytest.raises(ValueError, match=f"on backend {backend}; begin with dense"):
        sabot.kraus(register, damping(0.3), np.ones(1, bool), draws)


INCOMPLETE = {
    "not complete: the sum of K†K is \\[\\[": [[[1, 0], [0, 0.9]], [[0, 0.3], [0, 0]]],
    "not complete: the sum of K†K of photon 1 is": [[ONE], [0.5 * ONE], [ONE]],
    r"shape \(2, 2\) is neither \(m, 2, 2\) nor \(3, m, 2, 2\)": ONE,
    r"shape \(2, 1, 2, 2\) is neither": [[ONE], [ONE]],
    "17 operators; give 1 to 16": [ONE] + [0 * ONE] * MOST_OPERATORS,
    "0 operators": np.zeros((0, 2, 2)),
    "hold what is not a number": [np.full((2, 2), np.nan)],
    "could not|inhomogeneous|complex": "damping",
}


@pytest.mark.parametrize("words", INCOMPLETE)
def test_what_is_no_channel_is_refused_by_name(model: str, words: str) -> None:
    async def ask(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        with pytest.raises(BadConfig, match=rf"models\.py:Channel: Kraus operators.*{words}"):
            await alice.create(3)

    source = PairSource(noise=model, noise_parameters={"kraus": INCOMPLETE[words]})
    act(ask, Device(source=source))


def test_rounding_is_no_reason_to_refuse() -> None:
    assert wrong_with(some_channel(1, 4).astype(np.complex64).astype(np.complex128), 1) is not None
    assert wrong_with(some_channel(1, 4) * (1 + 1e-12), 1) is None


def test_fibres_act_in_the_order_in_which_light_passes_them(model: str) -> None:
    """X and then damping, the X of a switch, an angle, a turn, and a channel: no two commute."""
    turn = np.array([0.3, -0.5, 0.7, 0.2])
    turn /= np.linalg.norm(turn)
    last = some_channel(5, 3)
    # Of polarisation, which an angle of time bins would not meet but for a model of one's own.
    fibers = (
        {"pauli_x": 1.0, "noise": model, "noise_parameters": {"kraus": damping(0.6), "angle": 0.9}},
        {"noise": model, "noise_parameters": {"kraus": last, "turn": turn.tolist()}},
    )
    w, x, y, z = turn
    steps: list[list[Matrix]] = [
        [X],
        [np.diag([np.exp(-0.45j), np.exp(0.45j)])],
        list(damping(0.6)),
        [X],
        [w * ONE - 1j * (x * X + y * Y + z * Z)],
        list(last),
    ]
    state = pair()
    for step in steps:
        state = through(state, 1, step)
    for bases in ((0, 0), (1, 1), (2, 1)):

        async def run(laboratory: Laboratory, bases: tuple[int, int] = bases) -> None:
            alice, bob = laboratory.host("alice"), laboratory.host("bob")
            await laboratory.connect("q1", {1: 2})
            await alice.create(COUNT)
            await alice.send({(0, 1): "alice-q0"})
            await bob.receive((0, 1), "bob-q0")
            first = await alice.measure((0, 0), bases=np.full(COUNT, bases[0], np.uint8))
            second = await bob.measure((0, 1), bases=np.full(COUNT, bases[1], np.uint8))
            require(both(first, second), outcomes(state, bases))

        act(run, fibers=fibers, rotation=1)


def test_extra_pairs_photons_of_a_pulse_meet_it_too(model: str) -> None:
    """Damped wholly, every photon is in |0>: no pulse of two has both detectors click."""
    fiber = {"noise": model, "noise_parameters": {"kraus": damping(1.0)}}

    async def run(laboratory: Laboratory) -> None:
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await laboratory.connect("q1", {1: 2})
        await alice.prepare(np.full(COUNT, PREPARED_ONE, np.uint8))
        await alice.send({(0, 0): "alice-q0"}, rate_hz=1_000_000)
        await bob.receive((0, 0), "bob-q0")
        bits = await bob.measure((0, 0))
        assert within(int((bits == NO_CLICK).sum()), COUNT, float(np.exp(-2)))
        assert set(bits.tolist()) == {0, NO_CLICK}

    act(run, Device(source=PairSource(statistics="poisson", mean_pairs=2.0)), fibers=(fiber, {}))


def test_a_source_s_pairs_meet_it_with_one_half(model: str) -> None:
    """And the matrices agree with the closed form of one half: F = (1 + sqrt(1 - gamma))^2 / 4."""
    gamma = 0.4
    state = through(pair(), 0, damping(gamma))
    assert bell_outcomes(state)[0] == pytest.approx((1 + np.sqrt(1 - gamma)) ** 2 / 4)

    async def run(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        assert (await alice.create(COUNT)).exact
        require(await alice.bell_measure((0, 0), (0, 1)), bell_outcomes(state))

    own = {"noise": model, "noise_parameters": {"kraus": damping(gamma)}}
    act(run, Device(source=PairSource(**own)))  # type: ignore[arg-type]


def test_a_memory_relaxes_as_the_example_says() -> None:
    """Both halves, towards a state with .2 of |1>: generalised amplitude damping by definition."""
    wait_s, time_s, excited = 0.02, 0.05, 0.2
    down, kept = damping(1 - np.exp(-wait_s / time_s)), 1 - excited
    up = X @ down @ X
    operators = [*(np.sqrt(kept) * down), *(np.sqrt(excited) * up)]
    state = through(through(pair(), 0, operators), 1, operators)

    async def run(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        for half in (0, 1):
            await alice.store((0, half))
        await laboratory.wait(wait_s)
        require(await alice.bell_measure((0, 0), (0, 1)), bell_outcomes(state))

    parameters = {"time_s": time_s, "excited": excited}
    act(run, Device(memory=Memory(noise=RELAXING, noise_parameters=parameters)))


def test_gates_let_those_qubits_meet_it_that_they_act_on(model: str) -> None:
    """An X on every other qubit, then a CX: from |0> to |1> with .3, behind each that acts."""
    count = 2 * COUNT

    async def run(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        for number in (0, 1):
            await alice.create(count, number, CreateRequest.ZEROS)
        await alice.apply((0, 0), np.tile(np.array([1, 0], np.uint8), COUNT))
        gate = Gate(name=Gate.CX)
        gate.target.session, gate.target.number = 1, 1
        await alice.apply((0, 0), gates=[gate])
        first, second = await alice.measure((0, 0)), await alice.measure((1, 0))
        assert first[::2].all()
        assert second[::2].all()
        require(both(first, second)[1::2], [0.49, 0.21, 0.21, 0.09])

    own = {"noise": model, "noise_parameters": {"kraus": X @ damping(0.3) @ X}}
    act(run, Device(gates=Gates(**own)))  # type: ignore[arg-type]


def test_gates_of_a_bell_measurement_let_its_qubits_meet_it_behind_each(model: str) -> None:
    """From |1> to |0> with .3, behind the CX on both qubits, behind the H on one: in matrices."""
    phi = np.array([1, 0, 0, 1]) / np.sqrt(2)
    state = np.outer(phi, phi).astype(np.complex128)
    idle, damped = np.eye(2), damping(0.3)
    hadamard = np.kron(np.array([[1, 1], [1, -1]]) / np.sqrt(2), idle)
    for gate, both in ((np.eye(4)[[0, 1, 3, 2]], True), (hadamard, False)):
        state = gate @ state @ gate.T
        for first in (True, False)[: 1 + both]:
            ops = [np.kron(k, idle) if first else np.kron(idle, k) for k in damped]
            state = np.sum([op @ state @ op.conj().T for op in ops], axis=0)

    async def run(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        found = await alice.bell_measure((0, 0), (0, 1))
        require(found, np.diag(state).real.tolist())

    own = {"noise": model, "noise_parameters": {"kraus": damped}}
    act(run, Device(gates=Gates(**own), analyser=BellAnalyser("gates")))  # type: ignore[arg-type]


def test_detectors_tell_a_one_as_a_zero_in_any_basis(model: str) -> None:
    """They act on readings: 1 is read as 0 with .3, and 0 never as 1."""
    states = np.tile(np.arange(6, dtype=np.uint8), COUNT)  # |0> |1> |+> |-> |+i> |-i>

    async def run(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.prepare(states)
        report = await alice.measure((0, 0), bases=states // 2)
        assert not report[states % 2 == 0].any()
        for state in (1, 3, 5):
            assert within(int(report[states == state].sum()), COUNT, 0.7)
        bits = states[states < 2]
        for basis, angle_rad in ((3, pi / 4), (4, -pi / 4)):  # halfway to |+> and to |->
            await alice.prepare(bits, basis)
            await alice.apply((basis, 0), gates=[Gate(name=Gate.RY, angle_rad=angle_rad)])
            report = await alice.measure((basis, 0), bases=np.full(bits.size, basis, np.uint8))
            assert not report[bits == 0].any()
            assert within(int(report[bits == 1].sum()), COUNT, 0.7)
        await alice.create(COUNT, 1)
        expected = bell_outcomes(through(pair(), 0, damping(0.3)))
        require(await alice.bell_measure((1, 0), (1, 1)), expected)

    own = {"noise": model, "noise_parameters": {"kraus": damping(0.3)}}
    act(run, Device(detectors=Detectors(**own)))  # type: ignore[arg-type]
