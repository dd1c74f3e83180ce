"""Stabilizer states held by stim (Gidney, arXiv:2103.02202): one simulator for all members.

Members differ from the simulator's state by a Pauli frame: an X and a Z bit for each qubit.
"""

from typing import ClassVar, Self

import numpy as np
import stim
from numpy.typing import NDArray

from dispatcher.sabot.backend import (
    Bits,
    Bytes,
    CliffordName,
    Generators,
    Randomness,
    independent_groups,
)


class StimState:
    """A stabilizer state of n qubits, with a Pauli frame for each of k members."""

    NAME: ClassVar[str] = "stim"

    def __init__(self, qubits: int, members: int = 1) -> None:
        # The frames undo the simulator's draws: outcomes come from the caller.
        self._simulator = stim.TableauSimulator(seed=0)
        self._simulator.set_num_qubits(qubits)
        self._x: Bytes = np.zeros((qubits, members), dtype=np.uint8)
        self._z: Bytes = np.zeros((qubits, members), dtype=np.uint8)

    @classmethod
    def _of(cls, simulator: stim.TableauSimulator, x: Bytes, z: Bytes) -> Self:
        state = cls(0, 0)
        state._simulator, state._x, state._z = simulator, x, z
        return state

    @property
    def qubits(self) -> int:
        return len(self._x)

    @property
    def members(self) -> int:
        return int(self._x.shape[1])

    @property
    def nbytes(self) -> int:
        """Return the memory of the frames and of a tableau of 2n rows of 2n + 1 bits."""
        rows = 2 * self.qubits
        return self._x.nbytes + self._z.nbytes + rows * (rows + 1) // 8

    def generators(self) -> Generators:
        rows = self._simulator.canonical_stabilizers()
        x, z = _letters(rows)
        plain = np.array([row.sign == -1 for row in rows], dtype=np.uint8)
        flips = x.astype(np.uint8) @ self._z + z.astype(np.uint8) @ self._x
        return Generators(x, z, (flips + plain[:, None]) & np.uint8(1))

    def gate(self, name: CliffordName, *qubits: int) -> None:
        x, z = self._x, self._z
        match name, qubits:
            case "H", (qubit,):
                self._simulator.h(qubit)
                x[qubit], z[qubit] = z[qubit], x[qubit].copy()
            case "S", (qubit,):
                self._simulator.s(qubit)
                z[qubit] ^= x[qubit]
            case "S_DAG", (qubit,):
                self._simulator.s_dag(qubit)
                z[qubit] ^= x[qubit]
            case "CX", (control, target):
                self._simulator.cx(control, target)
                x[target] ^= x[control]
                z[control] ^= z[target]
            case "CZ", (control, target):
                self._simulator.cz(control, target)
                z[target] ^= x[control]
                z[control] ^= x[target]
            case _:
                raise ValueError(f"gate {name} does not act on {len(qubits)} qubits")

    def pauli(self, qubit: int, paulis: Bytes) -> None:
        self._x[qubit] ^= paulis & 1
        self._z[qubit] ^= paulis >> 1

    def measure(self, qubit: int, randomness: Randomness) -> tuple[Bytes, bool]:
        outcome, kickback = self._simulator.measure_kickback(qubit)
        value = self._x[qubit] ^ np.uint8(outcome)
        if kickback is None:
            return value, True
        bits = randomness.bits().copy()
        x, z = kickback.to_numpy()
        flips = value ^ bits
        self._x[: len(x)][x] ^= flips
        self._z[: len(z)][z] ^= flips
        return bits, False

    def discard(self, qubit: int) -> None:
        if not self._simulator.peek_z(qubit):
            raise ValueError(f"qubit {qubit} is not in a state of Z: measure it first")
        rows = [str(row) for row in self._simulator.canonical_stabilizers()]
        # Among reduced generators the qubit stands alone as Z.
        rest = [row[: qubit + 1] + row[qubit + 2 :] for row in rows if row[qubit + 1] == "_"]
        self._simulator = _simulator(rest)
        self._x, self._z = (np.delete(frame, qubit, axis=0) for frame in (self._x, self._z))

    def tensor(self, other: Self) -> Self:
        simulator = stim.TableauSimulator(seed=0)
        simulator.set_inverse_tableau(
            self._simulator.current_inverse_tableau() + other._simulator.current_inverse_tableau()
        )
        x, z = np.concatenate((self._x, other._x)), np.concatenate((self._z, other._z))
        return self._of(simulator, x, z)

    def take(self, members: NDArray[np.intp]) -> Self:
        return self._of(
            self._simulator.copy(), self._x.take(members, axis=1), self._z.take(members, axis=1)
        )

    def factor(self) -> list[tuple[list[int], Self]]:
        rows = self._simulator.canonical_stabilizers()
        x, z = _letters(rows)
        groups = independent_groups(x | z)
        if len(groups) == 1:
            return [(list(range(self.qubits)), self)]
        texts = [str(row) for row in rows]
        parts = []
        for group, qubits in groups:
            letters = [
                texts[row][0] + "".join(texts[row][qubit + 1] for qubit in qubits) for row in group
            ]
            part = self._of(_simulator(letters), self._x[qubits], self._z[qubits])
            parts.append((qubits, part))
        return parts


def _simulator(stabilizers: list[str]) -> stim.TableauSimulator:
    simulator = stim.TableauSimulator(seed=0)
    if stabilizers:
        tableau = stim.Tableau.from_stabilizers([stim.PauliString(row) for row in stabilizers])
        simulator.set_inverse_tableau(tableau.inverse())
    return simulator


def _letters(rows: list[stim.PauliString]) -> tuple[Bits, Bits]:
    """Return where Pauli strings have an X bit and where a Z bit, shape (n, n) each."""
    bits = [row.to_numpy() for row in rows]
    return np.array([x for x, _z in bits]), np.array([z for _x, z in bits])
