"""State vectors against matrices written down here, and the limits that they keep."""

from cmath import exp
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest
from sabot_states import given, overlaps

from dispatcher.sabot.backend import GateName
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.gates import as_clifford

A = 0.7
MATRICES: list[tuple[GateName, float, list[list[complex]]]] = [
    ("H", 0, [[0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]]),
    ("S", 0, [[1, 0], [0, 1j]]),
    ("S_DAG", 0, [[1, 0], [0, -1j]]),
    ("T", 0, [[1, 0], [0, exp(1j * pi / 4)]]),
    ("T_DAG", 0, [[1, 0], [0, exp(-1j * pi / 4)]]),
    ("RX", A, [[cos(A / 2), -1j * sin(A / 2)], [-1j * sin(A / 2), cos(A / 2)]]),
    ("RY", A, [[cos(A / 2), -sin(A / 2)], [sin(A / 2), cos(A / 2)]]),
    ("RZ", A, [[exp(-1j * A / 2), 0], [0, exp(1j * A / 2)]]),
]


def some_state(qubits: int, members: int, seed: int = 1) -> Dense:
    """Return a state without symmetries, made by gates."""
    random, state = np.random.default_rng(seed), Dense(qubits, members)
    for _ in range(3):
        for qubit in range(qubits):
            state.gate("RY", qubit, angle_rad=random.random() * 6)
            state.gate("RZ", qubit, angle_rad=random.random() * 6)
            state.pauli(qubit, random.integers(0, 4, members, dtype=np.uint8))
        for qubit in range(1, qubits):
            state.gate("CX", qubit - 1, qubit)
    return state


def on_qubit(matrix: Any, qubit: int, qubits: int) -> Any:
    """Return the matrix of a one-qubit gate on all qubits; qubit 0 is the last factor."""
    whole = np.eye(1)
    for place in reversed(range(qubits)):
        whole = np.kron(whole, matrix if place == qubit else np.eye(2))
    return whole


@pytest.mark.parametrize("qubit", [0, 1, 2])
@pytest.mark.parametrize(("name", "angle", "matrix"), MATRICES)
def test_gates_are_their_matrices(
    name: GateName, angle: float, matrix: list[list[complex]], qubit: int
) -> None:
    state = some_state(3, 4)
    expected = state.amplitudes @ on_qubit(np.array(matrix), qubit, 3).T
    state.gate(name, qubit, angle_rad=angle)
    assert np.allclose(np.abs(np.sum(expected.conj() * state.amplitudes, axis=1)), 1)


@pytest.mark.parametrize("qubit", [0, 1, 2])
@pytest.mark.parametrize("name", ["RX", "RY", "RZ"])
def test_each_member_can_be_turned_by_an_angle_of_its_own(name: GateName, qubit: int) -> None:
    angles = np.array([0.0, 0.3, -2.0, 5.0])
    state = some_state(3, len(angles))
    alone = [state.take(np.array([member])) for member in range(len(angles))]
    state.gate(name, qubit, angle_rad=angles)
    for one, angle in zip(alone, angles.tolist(), strict=True):
        one.gate(name, qubit, angle_rad=angle)
    assert np.allclose(state.amplitudes, np.concatenate([one.amplitudes for one in alone]))


def test_controlled_gates_are_their_permutation_and_signs() -> None:
    state = some_state(3, 4)
    before = state.amplitudes
    state.gate("CX", 2, 0)
    index = [0, 1, 2, 3, 5, 4, 7, 6]  # qubit 0 flips where qubit 2 is 1
    assert np.allclose(state.amplitudes, before[:, index])
    state.gate("CZ", 0, 1)
    assert np.allclose(state.amplitudes, before[:, index] * [1, 1, 1, -1, 1, 1, 1, -1])


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("name", ["RX", "RY", "RZ"])
@pytest.mark.parametrize("quarters", range(-5, 6))
def test_quarter_turns_are_clifford_gates(name: GateName, quarters: int) -> None:
    turned, gates = some_state(2, 3), some_state(2, 3)
    turned.gate(name, 1, angle_rad=quarters * pi / 2)
    cliffords = as_clifford(name, quarters * pi / 2)
    assert cliffords is not None
    for clifford in cliffords:
        gates.gate(clifford, 1)
    assert np.allclose(overlaps(turned, gates), 1)
    assert as_clifford(name, quarters * pi / 2 + 0.01) is None


def test_outcomes_follow_the_amplitudes() -> None:
    members, random = 40_000, np.random.default_rng(2)
    for angle in (0.3, 1.0, 2.5):
        qubit = Dense(1, members)
        qubit.gate("RY", 0, angle_rad=angle)
        outcomes, determined = qubit.measure(0, PhotonDraws.by(random, members))
        chance = sin(angle / 2) ** 2
        sigma = (members * chance * (1 - chance)) ** 0.5
        assert abs(int(outcomes.sum()) - members * chance) < 5 * sigma
        assert not determined
        again, determined = qubit.measure(0, PhotonDraws.by(random, members))
        assert (again == outcomes).all()
        assert determined


def test_rounding_makes_no_certain_outcome_uncertain() -> None:
    for angle in np.linspace(0.1, 3, 30).tolist():
        qubit = Dense(1, 2)
        for turn in (angle, 2 * angle, -3 * angle):
            qubit.gate("RY", 0, angle_rad=turn)
        qubit.pauli(0, np.array([0, 1], dtype=np.uint8))
        outcomes, determined = qubit.measure(0, given(1, 0))
        assert determined
        assert outcomes.tolist() == [0, 1]


def test_a_partly_entangled_pair_stays_together_and_its_measured_half_leaves() -> None:
    state = some_state(2, 3).tensor(some_state(1, 3, seed=5))
    assert [qubits for qubits, _part in state.factor()] == [[0, 1], [2]]
    state.measure(1, given(0, 1, 1))
    assert [qubits for qubits, _part in state.factor()] == [[0], [1], [2]]


def test_a_part_of_scattered_qubits_is_found() -> None:
    state = Dense(4, 2)  # 0 with 2, 1 with 3, in a state that is no stabilizer state
    for control, target in ((0, 2), (1, 3)):
        state.gate("RY", control, angle_rad=1.0)
        state.gate("CX", control, target)
        state.gate("T", target)
        state.gate("RX", target, angle_rad=0.4)
    parts = state.factor()
    assert [qubits for qubits, _part in parts] == [[0, 2], [1, 3]]
    # Of qubits in the order 0, 2, 1, 3: swap the middle ones to compare.
    joint = parts[0][1].tensor(parts[1][1])
    for control, target in ((1, 2), (2, 1), (1, 2)):
        joint.gate("CX", control, target)
    assert np.allclose(overlaps(joint, state), 1)
