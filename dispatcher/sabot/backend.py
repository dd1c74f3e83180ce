"""The interface of Sabot's backends: k equal systems of n qubits, simulated at once.

The factors of a stabilizer state: qubits that are independent of all others.

The reduced row echelon form of a direct sum is that of its parts, so rows that share no
qubit in it belong to separate states (linear algebra over GF(2)).
"""

from collections.abc import Sequence
from typing import ClassVar, Literal, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

CliffordName = Literal["H", "S", "S_DAG", "CX", "CZ"]
GateName = Literal["H", "S", "S_DAG", "CX", "CZ", "T", "T_DAG", "RX", "RY", "RZ"]
Bytes = NDArray[np.uint8]
Angle = float | NDArray[np.float64]  # of a rotation: the same for all, or one for each member


class Generators(NamedTuple):
    """The stabilizers of n qubits: the members' differ in their signs alone."""

    x: NDArray[np.bool_]  # shape (n, n): a row has X or Y on these qubits
    z: NDArray[np.bool_]  # and Z or Y on these
    signs: Bytes  # shape (n, k): 1 for minus


class Randomness(Protocol):
    """Random numbers for a measurement, drawn only if they are asked for."""

    def bits(self) -> Bytes:
        """Return a fair bit for each member, shape (k,)."""

    def uniform(self) -> NDArray[np.float64]:
        """Return a number from [0, 1) for each member; bits() are their first binary digits."""


class Backend(Protocol):
    """The joint state of n qubits, once for each of k members that had the same gates.

    Members may differ by the Paulis applied to them and by their measured outcomes.
    """

    NAME: ClassVar[str]

    def __init__(self, qubits: int, members: int) -> None:
        """Begin with every qubit of every member in |0>."""

    @property
    def qubits(self) -> int:
        """Return n."""

    @property
    def members(self) -> int:
        """Return k."""

    @property
    def nbytes(self) -> int:
        """Return the memory that the state takes, in bytes."""

    def generators(self) -> Generators:
        """Return the stabilizers; raise ValueError if the backend has none."""

    def gate(self, name: CliffordName, *qubits: int) -> None:
        """Apply a Clifford gate to every member."""

    def pauli(self, qubit: int, paulis: Bytes) -> None:
        """Apply to member j the Pauli paulis[j]: 0 I, 1 X, 2 Z, 3 XZ."""

    def measure(self, qubit: int, randomness: Randomness) -> tuple[Bytes, bool]:
        """Measure Z; return a bit for each member and whether the state determined them.

        Where both outcomes are equally likely the fair bit is the outcome, on any backend.
        """

    def discard(self, qubit: int) -> None:
        """Drop a qubit that has just been measured; those behind it move up by one."""

    def tensor(self, other: Self) -> Self:
        """Return the joint state of both; the other's qubits follow this one's."""

    def take(self, members: NDArray[np.intp]) -> Self:
        """Return a copy that holds these members alone."""

    def factor(self) -> Sequence[tuple[list[int], Self]]:
        """Return the independent parts of the state, each with the qubits it consists of."""


class Begin(Protocol):
    """A constructor of a backend's states: its class, or a choice between its classes."""

    @property
    def NAME(self) -> str:  # noqa: N802 (a constant of classes)
        """Return the backend's name."""

    def __call__(self, qubits: int, members: int, /) -> Backend:
        """Return the state with every qubit of every member in |0>."""


Bits = NDArray[np.bool_]


def eliminate(generators: Bits) -> tuple[Bits, list[tuple[int, int]]]:
    """Bring generators, shape (n, 2n), into reduced form up to the order of the rows.

    Return them and the steps: (row, by) stands for adding row `by` to `row`.
    """
    rows = generators.copy()
    steps: list[tuple[int, int]] = []
    free = np.ones(len(rows), dtype=bool)
    for column in range(rows.shape[1]):
        candidates = np.flatnonzero(rows[:, column] & free)
        if not candidates.size:
            continue
        pivot = int(candidates[0])
        free[pivot] = False
        others = np.flatnonzero(rows[:, column])
        others = others[others != pivot]
        rows[others] ^= rows[pivot]
        steps += [(int(row), pivot) for row in others]
    return rows, steps


def independent_groups(support: Bits) -> list[tuple[list[int], list[int]]]:
    """Group rows and qubits of support, shape (rows, qubits), that hang together.

    Return (rows, qubits) of each group, ordered by their first qubit.
    """
    groups: list[tuple[Bits, list[int]]] = []
    for row, touched in enumerate(support):
        rows, qubits = [row], touched.copy()
        apart = []
        for group_qubits, group_rows in groups:
            if (group_qubits & qubits).any():
                qubits |= group_qubits
                rows += group_rows
            else:
                apart.append((group_qubits, group_rows))
        groups = [*apart, (qubits, rows)]
    factors = [(sorted(rows), np.flatnonzero(qubits).tolist()) for qubits, rows in groups]
    return sorted(factors, key=lambda group: group[1])
