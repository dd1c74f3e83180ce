"""Every backend against stim, and against each other, on random circuits."""

from typing import TypeAlias

import numpy as np
import pytest
import stim
from numpy.random import Generator
from sabot_states import canonical, draw_gate, draw_paulis, given, overlaps

from dispatcher.sabot.backend import Backend
from dispatcher.sabot.backends import BACKENDS, as_dense, tensor
from dispatcher.sabot.bit_columns import BitColumns
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.stim_state import StimState
from dispatcher.sabot.tableau import Tableau
from wire.parameters import network

Stabilizers: TypeAlias = type[Tableau] | type[BitColumns] | type[StimState]
STABILIZERS = [Tableau, BitColumns, StimState]
PAULIS = "IXZY"


def measured(state: Backend, simulator: stim.TableauSimulator, qubit: int, bit: int) -> int:
    """Measure in both; check that they agree on what is certain, and return the outcome."""
    (outcome,), determined = state.measure(qubit, given(bit))
    expected = simulator.peek_z(qubit)
    assert determined == bool(expected)
    if expected:
        assert outcome == (expected == -1)
    else:
        assert outcome == bit
        simulator.postselect_z(qubit, desired_value=bool(bit))
    return int(outcome)


def experiment(random: Generator, state: Backend, simulator: stim.TableauSimulator) -> None:
    """Do gates, Paulis, measurements, and gates that depend on their outcomes, to both."""
    qubits = state.qubits
    simulator.set_num_qubits(qubits)
    outcomes = [0]
    for _ in range(30):
        kind, qubit = random.random(), int(random.integers(qubits))
        name, chosen = draw_gate(random, qubits)
        if kind < 0.15:
            paulis = draw_paulis(random, 1)
            state.pauli(qubit, paulis)
            simulator.do(stim.CircuitInstruction(PAULIS[paulis[0]], [qubit]))
        elif kind < 0.35:
            outcomes.append(measured(state, simulator, qubit, int(random.integers(2))))
        elif kind < 0.8 or outcomes[-1]:  # the last kind: if the last outcome was 1
            state.gate(name, *chosen)
            getattr(simulator, name.lower())(*chosen)


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("first_seed", range(0, 1000, 100))
@pytest.mark.parametrize("backend", STABILIZERS)
def test_random_circuits_with_feed_forward_agree_with_stim(
    backend: Stabilizers, first_seed: int
) -> None:
    for seed in range(first_seed, first_seed + 100):
        random = np.random.default_rng(seed)
        state, simulator = backend(int(random.integers(1, 9)), 1), stim.TableauSimulator()
        experiment(random, state, simulator)
        assert canonical(state) == [str(row) for row in simulator.canonical_stabilizers()]


def grow(random: Generator, states: list[Backend], members: int) -> None:
    """Join one or two qubits, entangled or not, to each of the states."""
    qubits, gates = int(random.integers(1, 3)), int(random.integers(0, 6))
    drawn = [draw_gate(random, qubits) for _ in range(gates)]
    for index, state in enumerate(states):
        more = type(state)(qubits, members)
        for name, chosen in drawn:
            more.gate(name, *chosen)
        states[index] = tensor(state, more)


def same_experiment(random: Generator, states: list[Backend], members: int) -> None:
    """Do the same random thing to all states; measurements must agree, bit for bit."""
    qubits, kind = states[0].qubits, random.random()
    qubit, paulis = int(random.integers(qubits)), draw_paulis(random, members)
    name, chosen = draw_gate(random, qubits)
    if kind < 0.1:
        for state in states:
            state.pauli(qubit, paulis)
    elif kind < 0.3:
        draws = PhotonDraws.by(random, members)
        (outcome, determined), *rest = [state.measure(qubit, draws) for state in states]
        for other, other_determined in rest:
            assert other.tolist() == outcome.tolist()
            assert other_determined == determined
        if kind < 0.15 and qubits > 1:
            for state in states:
                state.discard(qubit)
    elif kind < 0.35 and qubits < 5:
        grow(random, states, members)
    else:
        for state in states:
            state.gate(name, *chosen)


def assert_same(one: Backend, other: Backend) -> None:
    """Check that all members of both have the same states, and the same parts."""
    assert np.allclose(overlaps(as_dense(one), as_dense(other)), 1)
    ours, theirs = one.factor(), other.factor()
    assert [qubits for qubits, _part in ours] == [qubits for qubits, _part in theirs]
    for (_qubits, part), (_same, their_part) in zip(ours, theirs, strict=True):
        assert np.allclose(overlaps(as_dense(part), as_dense(their_part)), 1)


@pytest.mark.by_day(every=8)
@pytest.mark.parametrize("seed", range(200))
@pytest.mark.parametrize("members", [1, 4])
def test_same_random_numbers_give_same_outcomes_on_every_backend(members: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    qubits = int(random.integers(1, 5))
    states: list[Backend] = [Tableau(qubits, members), StimState(qubits, members)]
    states.append(Dense(qubits, members))
    if members == 1:
        states.append(BitColumns(qubits))
    for _ in range(40):
        same_experiment(random, states, members)
    for state in states[1:]:
        assert_same(states[0], state)


@pytest.mark.parametrize("backend", [Tableau, BitColumns, StimState, Dense])
def test_a_measured_ghz_state_falls_apart(backend: type[Backend]) -> None:
    ghz = backend(3, 1)
    ghz.gate("H", 0)
    ghz.gate("CX", 0, 1)
    ghz.gate("CX", 1, 2)
    assert [qubits for qubits, _part in ghz.factor()] == [[0, 1, 2]]
    ghz.measure(0, given(1))
    assert [qubits for qubits, _part in ghz.factor()] == [[0], [1], [2]]


@pytest.mark.parametrize("backend", [Tableau, BitColumns, StimState, Dense])
def test_discarding_an_open_qubit_is_an_error(backend: type[Backend]) -> None:
    qubit = backend(1, 1)
    qubit.gate("H", 0)
    with pytest.raises(ValueError, match="measure it first"):
        qubit.discard(0)


@pytest.mark.parametrize("backend", [Tableau, BitColumns, StimState, Dense])
def test_a_gate_on_the_wrong_number_of_qubits_is_an_error(backend: type[Backend]) -> None:
    with pytest.raises(ValueError, match="gate CX does not act on 1 qubits"):
        backend(2, 1).gate("CX", 0)


def test_a_large_tableau_of_one_member_agrees_with_stim() -> None:
    random, qubits = np.random.default_rng(1), 70  # more than a machine word
    state, simulator = BitColumns(qubits), stim.TableauSimulator()
    simulator.set_num_qubits(qubits)
    for _ in range(20):
        for _ in range(2 * qubits):
            name, chosen = draw_gate(random, qubits)
            state.gate(name, *chosen)
            getattr(simulator, name.lower())(*chosen)
        for qubit in random.permutation(qubits)[: qubits // 2].tolist():
            measured(state, simulator, qubit, int(random.integers(2)))
    assert canonical(state) == [str(row) for row in simulator.canonical_stabilizers()]


def test_one_member_is_held_as_bit_columns_and_a_block_as_a_tableau() -> None:
    assert isinstance(BACKENDS["chp"](2, 1), BitColumns)
    assert isinstance(BACKENDS["chp"](2, 5), Tableau)


def test_every_backend_that_can_be_configured_is_there_under_its_name() -> None:
    assert tuple(BACKENDS) == network.BACKENDS
    assert all(name == begin(1, 3).NAME for name, begin in BACKENDS.items())
