"""Shots of a circuit that measures at its end: all are drawn from one state vector."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bytes, Randomness
from dispatcher.sabot.circuits.circuit import Barrier, Circuit, Gate, Measure
from dispatcher.sabot.dense import DIGITS, Dense


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
