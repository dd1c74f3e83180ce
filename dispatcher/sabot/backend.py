"""What Sabot asks of a backend: k equal systems of n qubits, simulated at once."""

from collections.abc import Sequence
from typing import ClassVar, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

GateName = Literal["H", "S", "S_DAG", "CX", "CZ"]
Bytes = NDArray[np.uint8]


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

    def gate(self, name: GateName, *qubits: int) -> None:
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
