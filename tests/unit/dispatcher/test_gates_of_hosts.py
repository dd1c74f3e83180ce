"""Gates with noise, Bell measurements made of them, within 5 standard errors; the seed is 1."""

from collections.abc import Awaitable, Callable
from dataclasses import replace

import numpy as np
import pytest
import uvloop
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.refusal import Refusal
from dispatcher.sabot.backend import Bytes
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Detectors, Device, Gates, Memory, PairSource

COUNT = 100_000
P1, P2 = 0.04, 0.08
H = Gate(name=Gate.H)


def cx(target: tuple[int, int]) -> Gate:
    """Return a CX onto a block of the session of the laboratory."""
    gate = Gate(name=Gate.CX)
    gate.target.session, gate.target.number, gate.target.half = 1, *target
    return gate


def scene(
    act: Callable[[Laboratory], Awaitable[None]], device: Device, backend: str = "chp"
) -> None:
    """Let something happen to alice, whose device is given."""

    async def inside() -> None:
        config = DispatcherConfig("", "", 1, {"alice": "a"}, [], [], devices={"alice": device})
        await act(Laboratory(replace(config, backend=backend)))

    uvloop.run(inside())


def between(act: Callable[[Laboratory], Awaitable[None]], device: Device, **fiber: float) -> None:
    """Let something happen to alice, whose device is given, and bob at the end of a fibre."""

    async def inside() -> None:
        ends = FiberEnd("alice", "alice-q0"), FiberEnd("bob", "bob-q0")
        fibers = [Fiber(*ends)]
        tokens, devices = {"alice": "a", "bob": "b"}, {"alice": device}
        await act(Laboratory(DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)))

    uvloop.run(inside())


def noisy(**more: object) -> Device:
    """Return a device whose gates err."""
    return replace(Device(gates=Gates("any", P1, P2)), **more)  # type: ignore[arg-type]


def counted(states: Bytes) -> list[int]:
    """Count Bell states."""
    return [int((states == state).sum()) for state in range(4)]


@pytest.mark.parametrize("backend", ["chp", "stim"])
def test_a_gate_on_one_qubit_leaves_each_pauli_with_a_quarter_of_p(backend: str) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        # H twice is nothing but its noise, twice.
        await alice.apply((0, 0), gates=[H, H])
        states = counted(await alice.bell_measure((0, 0), (0, 1)))
        wrong = (1 - (1 - P1) ** 2) / 4
        assert all(within(count, COUNT, wrong) for count in states[1:])

    scene(act, noisy(), backend)


def test_two_gates_on_one_block_have_noise_of_their_own() -> None:
    """The same errors twice would undo each other."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        for _ in range(2):
            await alice.apply((0, 0), gates=[H])
        states = counted(await alice.bell_measure((0, 0), (0, 1)))
        assert within(states[0], COUNT, 1 - 0.75 * (1 - (1 - P1) ** 2))

    scene(act, noisy())


def test_a_part_of_a_block_that_comes_back_meets_new_noise() -> None:
    """Half of the light strays in the switch, and comes to alice again."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await laboratory.connect("q1", {1: 3, 3: 2})  # light strays to outputs in use
        await alice.create(COUNT)
        await alice.apply((0, 1), gates=[H])
        await alice.send({(0, 1): "alice-q0"})
        await alice.receive((0, 1), "alice-q1")
        await alice.apply((0, 1), gates=[H])
        states = await alice.bell_measure((0, 0), (0, 1))
        there = states != NO_CLICK
        assert within(int(there.sum()), COUNT, 0.5)
        wrong = int((states[there] != 0).sum())
        assert within(wrong, int(there.sum()), 0.75 * (1 - (1 - P1) ** 2))

    async def inside() -> None:
        ports = [("alice", "alice-q0"), ("bob", "bob-q0"), ("alice", "alice-q1")]
        fibers = [
            Fiber(FiberEnd(*end), FiberEnd("q1", str(number)))
            for number, end in enumerate(ports, 1)
        ]
        switch = QuantumSwitch("q1", crosstalk_db=10 * float(np.log10(2)))
        tokens, devices = {"alice": "a", "bob": "b"}, {"alice": noisy()}
        config = DispatcherConfig("", "", 1, tokens, fibers, [switch], devices=devices)
        await act(Laboratory(config))

    uvloop.run(inside())


def test_pauli_operators_err_too_and_the_identity_does_not() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        operators = (np.arange(COUNT) % 4).astype(np.uint8)
        await alice.apply((0, 0), operators)
        errors = await alice.bell_measure((0, 0), (0, 1)) ^ operators
        assert not errors[operators == 0].any()
        for operator in (1, 2, 3):
            found = counted(errors[operators == operator])
            assert all(within(count, COUNT // 4, P1 / 4) for count in found[1:])

    scene(act, noisy())


def test_a_gate_on_two_qubits_leaves_each_of_fifteen_products_alike() -> None:
    """Two pairs, a CX twice between their halves: what is left are errors of both pairs."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        for number in (0, 1):
            await alice.create(COUNT, number)
        await alice.apply((0, 0), gates=[cx((1, 0)), cx((1, 0))])
        one = await alice.bell_measure((0, 0), (0, 1))
        other = await alice.bell_measure((1, 0), (1, 1))
        products = np.bincount(one + 4 * other, minlength=16)
        each = (1 - (1 - P2) ** 2) / 16
        assert within(int(products[1:].sum()), COUNT, 15 * each)
        assert all(within(int(count), COUNT, each) for count in products[1:])

    scene(act, noisy())


def test_a_lost_partner_keeps_the_noise_of_a_gate_away() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, state=CreateRequest.ZEROS)
        await alice.create(COUNT, 1, state=CreateRequest.ZEROS)
        await alice.store((1, 0))  # half of it is lost on reading out
        await alice.apply((0, 0), gates=[cx((1, 0))])
        target = await alice.measure((1, 0))
        control = await alice.measure((0, 0))
        there = target != NO_CLICK
        assert within(int(there.sum()), COUNT, 0.5)
        assert not control[~there].any()
        assert within(int(control[there].sum()), int(there.sum()), P2 / 2)

    scene(act, noisy(memory=Memory(efficiency=0.5)))


def test_a_bell_measurement_by_gates_tells_all_states_apart_with_the_noise_of_its_gates() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        states = (np.arange(COUNT) % 4).astype(np.uint8)
        await alice.apply((0, 0), states)
        errors = await alice.bell_measure((0, 0), (0, 1)) ^ states
        for state in range(4):
            found = counted(errors[states == state])
            assert all(within(count, COUNT // 4, P2 / 4) for count in found[1:])

    # The operators that make the states must not err: let gates on one qubit be perfect.
    gates = Gates("any", 0.0, P2)
    scene(act, Device(gates=gates, analyser=BellAnalyser("gates")))


FLIP, PHASE = np.array([[0, 1], [1, 0]], np.complex128), np.diag([1, -1]).astype(np.complex128)
PAULIS = {"I": np.eye(2), "X": FLIP, "Y": 1j * FLIP @ PHASE, "Z": PHASE}
Matrix = NDArray[np.complex128]


def depolarized(state: Matrix, p: float, on: str) -> Matrix:
    """Return a density matrix of two qubits after depolarising those marked `x` in `on`."""
    each = ["IXYZ" if mark == "x" else "I" for mark in on]
    errors = [np.kron(PAULIS[one], PAULIS[other]) for one in each[0] for other in each[1]]
    return (1 - p) * state + sum(p / len(errors) * e @ state @ e.conj().T for e in errors)


def bell_outcomes(p1: float, p2: float) -> NDArray[np.float64]:
    """Return how likely a CX, an H and two readings tell each Bell state of Phi+: in matrices."""
    phi = np.array([1, 0, 0, 1], np.complex128) / np.sqrt(2)
    state: Matrix = np.outer(phi, phi)
    controlled = np.eye(4)[[0, 1, 3, 2]]
    hadamard = np.kron(np.array([[1, 1], [1, -1]]) / np.sqrt(2), np.eye(2))
    state = depolarized(controlled @ state @ controlled.T, p2, "xx")
    state = depolarized(hadamard @ state @ hadamard.T, p1, "x.")
    return np.diag(state).real  # phase, parity: Phi+, Psi+, Phi-, Psi-


def test_the_reference_of_a_bell_measurement_by_gates_has_the_known_closed_form() -> None:
    wrong = [(1 - P2) * P1 / 2 + P2 / 4, P2 / 4]
    expected = [1 - wrong[0] - 2 * wrong[1], wrong[1], wrong[0], wrong[1]]
    np.testing.assert_allclose(bell_outcomes(P1, P2), expected)


@pytest.mark.parametrize(("p1", "p2"), [(P1, P2), (P1, 0.0), (0.2, 0.0)])
def test_both_gates_of_a_bell_measurement_err(p1: float, p2: float) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        found = counted(await alice.bell_measure((0, 0), (0, 1)))
        expected = bell_outcomes(p1, p2)
        assert all(within(n, COUNT, p) for n, p in zip(found, expected, strict=True))

    scene(act, Device(gates=Gates("any", p1, p2), analyser=BellAnalyser("gates")))


def test_swapping_by_a_noisy_hadamard_errs_in_the_phase_alone() -> None:
    """Perfect pairs, p1 = .2: each of two Bell measurements errs with p1/2 = .1."""

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        for number in (0, 1):
            await alice.create(COUNT, number)
        outcomes = await alice.bell_measure((0, 0), (1, 0))
        found = outcomes ^ await alice.bell_measure((0, 1), (1, 1))
        assert within(int(np.count_nonzero(found == 0)), COUNT, 0.9**2 + 0.1**2)
        assert within(int(np.count_nonzero(found == 2)), COUNT, 2 * 0.9 * 0.1)

    scene(act, Device(gates=Gates("any", 0.2, 0.0), analyser=BellAnalyser("gates")))


def test_qubits_that_gates_measure_need_not_interfere() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT)
        found = await alice.bell_measure((0, 0), (0, 1))
        assert not found.any()

    scene(act, Device(analyser=BellAnalyser("gates", visibility=0.0)))


CANNOT = {
    "emit": "feature EMIT is needed: alice has no source of light",
    "store": "feature STORE is needed: alice has no memory",
    "gate": "feature GATE is needed: alice does Pauli operators alone",
    "measure": "feature MEASURE is needed: alice has no detectors that click",
}
WITHOUT = {
    "emit": Device(replace(Device().source, statistics="none")),
    "store": Device(memory=Memory(capacity=0)),
    "gate": Device(gates=Gates("paulis")),
    "measure": Device(detectors=Detectors(efficiency=0.0)),
}


@pytest.mark.parametrize("feature", CANNOT)
def test_what_a_host_cannot_do_is_refused_by_name_and_changes_nothing(feature: str) -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        if feature != "emit":
            await alice.create(4)
        live = laboratory.layer.sabot.live_qubits
        acts: dict[str, list[Callable[[], Awaitable[object]]]] = {
            "emit": [lambda: alice.create(4)],
            "store": [lambda: alice.store((0, 0))],
            "gate": [
                lambda: alice.apply((0, 0), gates=[H]),
                lambda: alice.apply((0, 0), gates=[cx((0, 1))]),
            ],
            "measure": [
                lambda: alice.measure((0, 0), MeasureRequest.X),
                lambda: alice.bell_measure((0, 0), (0, 1)),
                lambda: alice.resend((0, 0), np.zeros(4, np.uint8)),
            ],
        }
        for one in acts[feature]:
            with pytest.raises(Refusal, match=CANNOT[feature]) as caught:
                await one()
            assert caught.value.code.name == "FAILED_PRECONDITION"
            assert laboratory.layer.sabot.live_qubits == live

    scene(act, WITHOUT[feature])


def test_modulators_still_do_pauli_operators() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(4)
        operators = np.arange(4, dtype=np.uint8)
        await alice.apply((0, 0), operators)
        np.testing.assert_array_equal(await alice.bell_measure((0, 0), (0, 1)), operators)

    scene(act, WITHOUT["gate"])


def test_a_host_without_a_source_prepares_what_it_keeps_and_sends_none_of_it() -> None:
    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.prepare(np.array([1, 0], np.uint8))
        with pytest.raises(Refusal, match="feature EMIT is needed"):
            await alice.send({(0, 0): "alice-q0"})
        assert (await alice.measure((0, 0))).tolist() == [1, 0]

    between(act, WITHOUT["emit"])


def test_qubits_of_a_host_itself_are_none_of_its_laser() -> None:
    """Of a laser nine pulses in ten are dark, and one state in ten is wrong: not of an ion."""
    laser = PairSource("poisson", 0.1, preparation_error=0.1, jitter_ps=50.0)

    async def act(laboratory: Laboratory) -> None:
        alice = laboratory.host("alice")
        await alice.create(COUNT, 0, CreateRequest.ZEROS)
        found = await alice.measure((0, 0))
        assert not (found == NO_CLICK).any()
        assert within(int(found.sum()), COUNT, 0.02)
        await alice.prepare(np.zeros(COUNT, np.uint8), 1)
        seen = int((await alice.measure((1, 0)) != NO_CLICK).sum())
        assert within(seen, COUNT, 1 - float(np.exp(-0.1)))

    scene(act, Device(source=laser, gates=Gates(initialization_error=0.02)))


def test_a_host_that_neither_emits_nor_stores_has_no_qubits_of_its_own() -> None:
    async def act(laboratory: Laboratory) -> None:
        with pytest.raises(Refusal, match="feature EMIT or STORE is needed"):
            await laboratory.host("alice").prepare(np.zeros(2, np.uint8))

    scene(act, replace(WITHOUT["emit"], memory=Memory(capacity=0)))
