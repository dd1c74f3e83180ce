"""The stabilizer tableau of Aaronson and Gottesman (quant-ph/0406196), for k members at once.

Rows 0..n-1 are destabilizers, n..2n-1 stabilizers. Members that underwent the same gates and
measurements share x and z and differ in the signs of their stabilizers. Signs of
destabilizers are never needed, nor that destabilizers commute with each other.
"""

from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import (
    Bits,
    Bytes,
    Generators,
    Randomness,
    eliminate,
    independent_groups,
)
from dispatcher.sabot.gates import NamedGates


class Tableau(NamedGates):
    """A stabilizer state of n qubits, with a sign of each stabilizer for each of k members."""

    NAME: ClassVar[str] = "chp"

    def __init__(self, qubits: int, members: int = 1) -> None:
        none, each = np.zeros((qubits, qubits), dtype=bool), np.eye(qubits, dtype=bool)
        self._x: Bits = np.concatenate((each, none))
        self._z: Bits = np.concatenate((none, each))
        self._signs: Bytes = np.zeros((qubits, members), dtype=np.uint8)

    @classmethod
    def from_rows(cls, x: Bits, z: Bits, signs: Bits) -> Self:
        """Return one member's state from all rows, shape (2n, n) each, and signs, shape (2n, 1)."""
        return cls._of(x, z, signs[len(signs) // 2 :].astype(np.uint8))

    def rows(self) -> tuple[Bits, Bits, Bytes]:
        """Return all rows, shape (2n, n) each, and their signs, shape (2n, k)."""
        return self._x, self._z, np.concatenate((np.zeros_like(self._signs), self._signs))

    @classmethod
    def _of(cls, x: Bits, z: Bits, signs: Bytes) -> Self:
        state = cls(0, 0)
        state._x, state._z, state._signs = x, z, signs
        return state

    @property
    def qubits(self) -> int:
        return len(self._signs)

    @property
    def members(self) -> int:
        return int(self._signs.shape[1])

    @property
    def nbytes(self) -> int:
        return self._x.nbytes + self._z.nbytes + self._signs.nbytes

    def __str__(self) -> str:
        return self.stabilizers(0)

    def generators(self) -> Generators:
        return Generators(self._x[self.qubits :], self._z[self.qubits :], self._signs)

    def stabilizers(self, member: int) -> str:
        lines = []
        for row in range(self.qubits, 2 * self.qubits):
            sign = "-" if self._signs[row - self.qubits, member] else "+"
            letters = self._x[row] + 2 * self._z[row]
            lines.append(sign + "".join("_XZY"[letter] for letter in letters))
        return "\n".join(lines)

    def h(self, qubit: int) -> None:
        x, z = self._x[:, qubit], self._z[:, qubit]
        self._flip(x & z)
        x ^= z
        z ^= x
        x ^= z

    def s(self, qubit: int) -> None:
        x, z = self._x[:, qubit], self._z[:, qubit]
        self._flip(x & z)
        z ^= x

    def s_dag(self, qubit: int) -> None:
        x, z = self._x[:, qubit], self._z[:, qubit]
        self._flip(x & ~z)
        z ^= x

    def cx(self, control: int, target: int) -> None:
        x, z = self._x, self._z
        self._flip(x[:, control] & z[:, target] & ~(x[:, target] ^ z[:, control]))
        x[:, target] ^= x[:, control]
        z[:, control] ^= z[:, target]

    def cz(self, control: int, target: int) -> None:
        self.h(target)
        self.cx(control, target)
        self.h(target)

    def pauli(self, qubit: int, paulis: Bytes) -> None:
        flips = (paulis & 1, paulis >> 1)
        for sign, x, z in zip(
            self._signs, self._x[self.qubits :, qubit], self._z[self.qubits :, qubit], strict=True
        ):
            if z:
                sign ^= flips[0]
            if x:
                sign ^= flips[1]

    def measure(self, qubit: int, randomness: Randomness) -> tuple[Bytes, bool]:
        count = self.qubits
        anticommuting = np.flatnonzero(self._x[count:, qubit])
        if not anticommuting.size:
            return self._determined(qubit), True
        pivot = count + int(anticommuting[0])
        for row in np.flatnonzero(self._x[:, qubit]):
            if row != pivot:
                self._multiply(int(row), pivot)
        for half in (self._x, self._z):
            half[pivot - count] = half[pivot]
            half[pivot] = False
        self._z[pivot, qubit] = True
        self._signs[pivot - count] = bits = randomness.bits()
        return bits.copy(), False

    def discard(self, qubit: int) -> None:
        count = self.qubits
        involved = np.flatnonzero(self._x[:count, qubit])
        if not involved.size or self._x[count:, qubit].any():
            raise ValueError(f"qubit {qubit} is not in a state of Z: measure it first")
        pivot = int(involved[0])
        for row in involved[1:]:
            self._combine(pivot, int(row))
        # The pivot's stabilizer is now Z of the qubit alone. Removing the column multiplies
        # the others by it, which needs their signs corrected.
        for row in np.flatnonzero(self._z[count:, qubit]):
            if row != pivot:
                self._signs[row] ^= self._signs[pivot]
        every = np.arange(count)
        self._restrict(every[every != pivot], every[every != qubit])

    def tensor(self, other: Self) -> Self:
        ours, theirs = self.qubits, other.qubits
        joint = type(self)(ours + theirs, 0)
        rows = (slice(0, ours), slice(ours + theirs, 2 * ours + theirs))
        their_rows = (slice(ours, ours + theirs), slice(2 * ours + theirs, None))
        for whole, half, their_half in (
            (joint._x, self._x, other._x),
            (joint._z, self._z, other._z),
        ):
            whole[:] = False
            for index in (0, 1):
                whole[rows[index], :ours] = half[index * ours : (index + 1) * ours]
                their_part = their_half[index * theirs : (index + 1) * theirs]
                whole[their_rows[index], ours:] = their_part
        joint._signs = np.concatenate((self._signs, other._signs))
        return joint

    def take(self, members: NDArray[np.intp]) -> Self:
        return self._of(self._x.copy(), self._z.copy(), self._signs.take(members, axis=1))

    def factor(self) -> list[tuple[list[int], Self]]:
        count = self.qubits
        if count == 1:
            return [([0], self)]
        generators = np.concatenate((self._x[count:], self._z[count:]), axis=1)
        reduced, steps = eliminate(generators)
        groups = independent_groups(reduced[:, :count] | reduced[:, count:])
        if len(groups) == 1:
            return [(list(range(count)), self)]
        for row, by in steps:
            self._combine(row, by)
        return [(qubits, self._part(rows, qubits)) for rows, qubits in groups]

    def _part(self, rows: list[int], qubits: list[int]) -> Self:
        part = self._of(self._x, self._z, self._signs)
        part._restrict(np.array(rows), np.array(qubits))
        return part

    def _restrict(self, rows: NDArray[np.intp], qubits: NDArray[np.intp]) -> None:
        both = np.concatenate((rows, rows + self.qubits))
        self._x = self._x[both[:, None], qubits]
        self._z = self._z[both[:, None], qubits]
        self._signs = self._signs[rows]

    def _flip(self, rows: Bits) -> None:
        for row in np.flatnonzero(rows[self.qubits :]):
            self._signs[row] ^= 1

    def _multiply(self, row: int, by: int) -> None:
        """Multiply a row by another; the sign follows if it is a stabilizer's."""
        count = self.qubits
        if row >= count:
            self._signs[row - count] ^= self._signs[by - count]
            if _phase(self._x[row], self._z[row], self._x[by], self._z[by]):
                self._signs[row - count] ^= 1
        self._x[row] ^= self._x[by]
        self._z[row] ^= self._z[by]

    def _combine(self, row: int, by: int) -> None:
        self._multiply(self.qubits + row, self.qubits + by)
        self._multiply(by, row)

    def _determined(self, qubit: int) -> Bytes:
        count = self.qubits
        x, z = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        bits = np.zeros(self.members, dtype=np.uint8)
        for row in np.flatnonzero(self._x[:count, qubit]):
            bits ^= self._signs[row]
            if _phase(x, z, self._x[count + row], self._z[count + row]):
                bits ^= 1
            x ^= self._x[count + row]
            z ^= self._z[count + row]
        return bits


def _phase(x: Bits, z: Bits, by_x: Bits, by_z: Bits) -> bool:
    """Return whether the product of two commuting Pauli strings carries a minus sign.

    A string is the product of i^(xz) X^x Z^z over its qubits, so that Y has x = z = 1.
    """
    before = np.count_nonzero(x & z) + np.count_nonzero(by_x & by_z)
    after = np.count_nonzero((x ^ by_x) & (z ^ by_z))
    return bool((before - after + 2 * np.count_nonzero(z & by_x)) % 4)
