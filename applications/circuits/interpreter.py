"""Runs a circuit on a backend: k shots are the k members of one state.

A condition or a measurement that holds for some shots only divides the state; Paulis under a
condition do not, because members may differ by them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from applications.circuits.circuit import (
    MAX_SHOTS,
    Barrier,
    Circuit,
    CircuitError,
    ClassicalRegister,
    Gate,
    If,
    Measure,
    Operation,
    Reset,
)
from dispatcher.sabot import gates
from dispatcher.sabot.backend import Backend, Begin, Bytes, CliffordName, GateName, Randomness
from dispatcher.sabot.capacity import require_amplitudes
from dispatcher.sabot.dense import DIGITS, Dense, TooLarge
from dispatcher.sabot.dense import MAX_QUBITS as MOST_DENSE
from dispatcher.sabot.draws import Draws, PhotonDraws
from dispatcher.sabot.registers import Mask


def measurements_at_end(circuit: Circuit) -> list[Measure] | None:
    """Return the measurements if each shot has the same gates and no qubit has one afterwards."""
    measurements: list[Measure] = []
    measured: set[int] = set()
    for operation in circuit.operations:
        match operation:
            case Measure(qubit):
                measurements.append(operation)
                measured.add(qubit)
            case Gate(_, qubits) if measured.isdisjoint(qubits):
                pass
            case Barrier():
                pass
            case _:
                return None
    return measurements


class Sampler:
    """Draws outcomes of qubits, one after the other, as measurements of each shot would."""

    def __init__(self, state: Dense, measurements: Sequence[Measure]) -> None:
        """Compute how likely a 1 of each qubit is after each sequence of outcomes before it."""
        self._measurements = measurements
        self._qubits = list(dict.fromkeys(measurement.qubit for measurement in measurements))
        joint = _joint(state, self._qubits)
        self._ones = [_ones(joint, place) for place in range(len(self._qubits))]

    def sample(self, bits: Bytes, draws: Callable[[int], Randomness]) -> None:
        """Fill the measured rows of an array of shape (bits, shots).

        `draws` returns the random numbers of the measurement of that number.
        """
        outcomes: dict[int, Bytes] = {}
        before = np.zeros(bits.shape[1], dtype=np.int64)
        for number, (qubit, bit) in enumerate((m.qubit, m.bit) for m in self._measurements):
            if qubit not in outcomes:
                one = self._ones[len(outcomes)][before]
                outcome = (draws(number).uniform() >= 1 - one).astype(np.uint8)
                outcomes[qubit] = outcome
                before = 2 * before + outcome
            bits[bit] = outcomes[qubit]


def _joint(state: Dense, qubits: Sequence[int]) -> NDArray[np.float64]:
    """Return the probabilities of all outcomes of some qubits, the first most significant."""
    weights = np.abs(state.amplitudes[0]) ** 2
    axes = [state.qubits - 1 - qubit for qubit in qubits]  # qubit 0 is the last axis
    others = tuple(set(range(state.qubits)) - set(axes))
    ordered = weights.reshape((2,) * state.qubits).transpose(*axes, *others)
    joint: NDArray[np.float64] = ordered.reshape(1 << len(qubits), -1).sum(axis=1)
    return joint


def _ones(joint: NDArray[np.float64], place: int) -> NDArray[np.float64]:
    """Return how likely the outcome in that place is 1, for each sequence of those before it."""
    pairs = joint.reshape(1 << place, 2, -1).sum(axis=2)
    both = pairs.sum(axis=1)
    ones = np.divide(pairs[:, 1], both, out=np.zeros_like(both), where=both > 0)
    rounded: NDArray[np.float64] = np.round(ones, DIGITS)
    return rounded


# The code of a backend's `pauli`; the phase of XZ against Y cannot be seen.
PAULIS = {"I": 0, "X": 1, "Z": 2, "Y": 3}
CLIFFORD = frozenset(gates.CLIFFORDS)
ROTATIONS = frozenset(gates.ROTATIONS)

MAX_RESULT_BITS = 1 << 28  # shots times classical bits
# Shots that are simulated at once, so that a state vector of each fits into 64 MB. It depends on
# the circuit alone: another backend draws the same random numbers.
BATCH_AMPLITUDES = 1 << 22
LARGEST_BATCH = 1 << 16


def run_circuit(circuit: Circuit, backend: Begin, shots: int, seed: int) -> Iterator[Bytes]:
    """Yield what was measured, batch by batch: arrays of shape (bits, shots of the batch).

    Raise CircuitError, before anything runs, for what this backend cannot run.
    """
    try:
        _check(circuit, backend, shots)
    except TooLarge as error:
        raise CircuitError(f"the backend {backend.NAME}: {error}") from error
    return _batches(circuit, backend, shots, Draws(seed))


def _check(circuit: Circuit, backend: Begin, shots: int) -> None:
    if not 1 <= shots <= MAX_SHOTS:
        raise CircuitError(f"{shots} shots: choose 1 to {MAX_SHOTS:,}")
    if shots * circuit.bits > MAX_RESULT_BITS:
        most = MAX_RESULT_BITS // circuit.bits
        raise CircuitError(f"{shots} shots of {circuit.bits} bits: choose at most {most:,} shots")
    if backend.NAME == Dense.NAME:
        require_amplitudes(circuit.qubits, 1, 0)
        return
    for gate in _gates(circuit.operations):
        if gate.name not in CLIFFORD and gate.name not in PAULIS:
            angle = f"({gate.angle_rad:.6g})" if gate.name in ROTATIONS else ""
            raise CircuitError(
                f"{gate.name}{angle} is not a Clifford gate, which {backend.NAME} cannot simulate; "
                "use the backend dense"
            )


def _gates(operations: tuple[Operation, ...]) -> Iterator[Gate]:
    for operation in operations:
        if isinstance(operation, If):
            yield from _gates(operation.operations)
        elif isinstance(operation, Gate):
            yield operation


def _batches(circuit: Circuit, backend: Begin, shots: int, draws: Draws) -> Iterator[Bytes]:
    size = LARGEST_BATCH
    if circuit.qubits <= MOST_DENSE:
        size = min(size, BATCH_AMPLITUDES >> circuit.qubits)
    measurements = measurements_at_end(circuit) if backend is Dense else None
    sampler = None if measurements is None else Sampler(_final_state(circuit), measurements)
    for number, first in enumerate(range(0, shots, size)):
        count = min(size, shots - first)
        if sampler is not None:
            bits: Bytes = np.zeros((circuit.bits, count), dtype=np.uint8)
            sampler.sample(bits, partial(_draws_of, draws, number, count))
            yield bits
            continue
        batch = _Batch(circuit, backend, count, draws, number)
        batch.run(circuit.operations, None)
        yield batch.bits


def _draws_of(draws: Draws, batch: int, shots: int, measured: int) -> PhotonDraws:
    return draws.photons((batch, measured, 0), "circuit", shots)


def _final_state(circuit: Circuit) -> Dense:
    state = Dense(circuit.qubits)
    for gate in _gates(circuit.operations):
        if gate.name in PAULIS:
            state.pauli(gate.qubits[0], np.full(1, PAULIS[gate.name], dtype=np.uint8))
        else:
            _apply(gate, state)
    return state


def _apply(gate: Gate, state: Backend) -> None:
    if isinstance(state, Dense):
        state.gate(cast(GateName, gate.name), *gate.qubits, angle_rad=gate.angle_rad)
    else:
        state.gate(cast(CliffordName, gate.name), *gate.qubits)


@dataclass
class _Branch:
    """Shots that have had the same gates and measurements."""

    members: NDArray[np.uint32]  # ascending
    state: Backend


class _Batch:
    """Shots that are simulated together."""

    def __init__(
        self, circuit: Circuit, backend: Begin, shots: int, draws: Draws, number: int
    ) -> None:
        self.bits: Bytes = np.zeros((circuit.bits, shots), dtype=np.uint8)
        self._shots, self._draws, self._number = shots, draws, number
        self._branches = [
            _Branch(np.arange(shots, dtype=np.uint32), backend(circuit.qubits, shots))
        ]
        self._measured = 0

    def run(self, operations: tuple[Operation, ...], where: Mask | None) -> None:
        """Do operations in order, to the shots of a mask; None: to all."""
        for operation in operations:
            match operation:
                case If(register, value, conditional):
                    holds = self._equals(register, value)
                    self.run(conditional, holds if where is None else holds & where)
                case Gate(name, qubits) if name in PAULIS:
                    self._pauli(qubits[0], PAULIS[name], where)
                case Gate():
                    self._gate(operation, where)
                case Measure(qubit, bit):
                    self._measure(qubit, bit, where)
                case Reset(qubit):
                    self._reset(qubit, where)
                case Barrier():
                    pass

    def _equals(self, register: ClassicalRegister, value: int) -> Mask:
        if value >> register.size:
            return np.zeros(self._shots, dtype=np.bool_)
        expected = np.array([value >> bit & 1 for bit in range(register.size)], dtype=np.uint8)
        actual = self.bits[register.first : register.first + register.size]
        equal: Mask = (actual == expected[:, None]).all(axis=0)
        return equal

    def _pauli(self, qubit: int, pauli: int, where: Mask | None) -> None:
        values = np.full(self._shots, pauli, dtype=np.uint8)
        if where is not None:
            values *= where
        for branch in self._branches:
            branch.state.pauli(qubit, values[branch.members])

    def _gate(self, gate: Gate, where: Mask | None) -> None:
        for branch in self._selected(where):
            _apply(gate, branch.state)

    def _measure(self, qubit: int, bit: int, where: Mask | None) -> None:
        for branch, outcomes in self._read(qubit, where):
            self.bits[bit, branch.members] = outcomes

    def _reset(self, qubit: int, where: Mask | None) -> None:
        for branch, outcomes in self._read(qubit, where):
            branch.state.pauli(qubit, outcomes)

    def _read(self, qubit: int, where: Mask | None) -> Iterator[tuple[_Branch, Bytes]]:
        """Measure Z of a qubit; each measurement of the circuit has random numbers of its own."""
        draws = _draws_of(self._draws, self._number, self._shots, self._measured)
        self._measured += 1
        for branch in self._selected(where):
            outcomes, _determined = branch.state.measure(qubit, draws.at(branch.members))
            yield branch, outcomes

    def _selected(self, where: Mask | None) -> list[_Branch]:
        if where is None:
            return self._branches
        selected, branches = [], []
        for branch in self._branches:
            mask = where[branch.members]
            parts = [branch] if mask.all() or not mask.any() else _divided(branch, mask)
            branches += parts
            selected += [part for part in parts if where[part.members[0]]]
        self._branches = branches
        return selected


def _divided(branch: _Branch, selected: Mask) -> list[_Branch]:
    parts = (np.flatnonzero(selected), np.flatnonzero(~selected))
    return [_Branch(branch.members[part], branch.state.take(part)) for part in parts]
