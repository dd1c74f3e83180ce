"""Gates and measurements a second of one component, beside stim's Python calls in the same run.

Both do the same random circuits: 2n gates (H, S and CX alike often, on new random qubits),
then every qubit is measured, about half of which is certain.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import stim

from dispatcher.sabot.bit_columns import BitColumns

CIRCUITS = {2: 2_000, 10: 400, 100: 20, 1_000: 1}  # by number of qubits
TURNS = 3  # the load of a machine changes: both take turns, and the best counts
SEED = 1

Step = tuple[str, tuple[int, ...]]


@dataclass
class Speed:
    """How many a second, at best."""

    gates: float = 0.0
    measurements: float = 0.0

    def improve(self, gates: float, measurements: float) -> None:
        self.gates = max(self.gates, gates)
        self.measurements = max(self.measurements, measurements)


def sabot_speed() -> Iterator[tuple[str, str]]:
    for qubits, count in CIRCUITS.items():
        circuits = [steps(np.random.default_rng(SEED + number), qubits) for number in range(count)]
        ours, theirs = Speed(), Speed()
        for _ in range(TURNS):
            theirs.improve(*stim_turn(circuits, qubits))
            ours.improve(*chp_turn(circuits, qubits))
        yield f"chp, {qubits:,} qubits, gates", compared(ours.gates, theirs.gates)
        text = compared(ours.measurements, theirs.measurements)
        yield f"chp, {qubits:,} qubits, measurements", text


def steps(random: np.random.Generator, qubits: int) -> list[Step]:
    drawn: list[Step] = []
    for name in random.choice(("h", "s", "cx"), 2 * qubits).tolist():
        operands = random.choice(qubits, 2 if name == "cx" else 1, replace=False)
        drawn.append((name, tuple(operands.tolist())))
    return drawn


def stim_turn(circuits: Sequence[Sequence[Step]], qubits: int) -> tuple[float, float]:
    simulator = stim.TableauSimulator(seed=SEED)
    simulator.set_num_qubits(qubits)
    return turn(simulator, simulator.measure, circuits, qubits)


def chp_turn(circuits: Sequence[Sequence[Step]], qubits: int) -> tuple[float, float]:
    """Return gates/s and measurements/s of our tableau of one member."""
    state = BitColumns(qubits)
    bits: Iterator[int] = cycle(np.random.default_rng(SEED).integers(0, 2, 10_000).tolist())

    def measure(qubit: int) -> int:
        if state.is_determined(qubit):
            return state.value(qubit)
        bit = next(bits)
        state.collapse(qubit, bit)
        return bit

    return turn(state, measure, circuits, qubits)


def turn(
    state: object,
    measure: Callable[[int], object],
    circuits: Sequence[Sequence[Step]],
    qubits: int,
) -> tuple[float, float]:
    """Return gates/s and measurements/s over all circuits, one after the other."""
    gates_s = measurements_s = 0.0
    for circuit in circuits:
        calls = [(getattr(state, name), operands) for name, operands in circuit]
        began = time.perf_counter()
        for gate, operands in calls:
            gate(*operands)
        done = time.perf_counter()
        for qubit in range(qubits):
            measure(qubit)
        measurements_s += time.perf_counter() - done
        gates_s += done - began
    gates = sum(map(len, circuits))
    return gates / gates_s, len(circuits) * qubits / measurements_s


def compared(ours: float, theirs: float) -> str:
    return f"{ours:,.0f}/s, {ours / theirs:.2f} times stim's {theirs:,.0f}/s"
