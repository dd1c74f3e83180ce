"""The tableau of Aaronson and Gottesman (quant-ph/0406196) for one member, as bit columns.

For each qubit, one Python integer has the X bits of all rows and one the Z bits: bits
0..n-1 are destabilizers, n..2n-1 stabilizers. A gate is a few operations on whole columns.
Signs of destabilizers mean nothing, as in the tableau of blocks.
"""

from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bits, Bytes, Generators, Randomness
from dispatcher.sabot.gates import NamedGates
from dispatcher.sabot.tableau import Tableau


class BitColumns(NamedGates):
    """A stabilizer state of n qubits."""

    NAME: ClassVar[str] = "chp"
    members = 1

    def __init__(self, qubits: int, members: int = 1) -> None:
        """Begin with every qubit in |0>; members must be 1."""
        if members != 1:
            raise ValueError(f"{members} members: bit columns hold one; use Tableau")
        self._x = [1 << qubit for qubit in range(qubits)]
        self._z = [1 << qubits << qubit for qubit in range(qubits)]
        self._signs = 0

    @classmethod
    def _of(cls, x: list[int], z: list[int], signs: int) -> Self:
        state = cls(0)
        state._x, state._z, state._signs = x, z, signs
        return state

    @classmethod
    def from_tableau(cls, tableau: Tableau) -> Self:
        """Return the state of a tableau's only member."""
        x, z, signs = tableau.rows()
        return cls._of(_integers(x), _integers(z), _integers(signs)[0])

    def as_tableau(self) -> Tableau:
        rows = 2 * self.qubits
        x, z, signs = (_bits(columns, rows) for columns in (self._x, self._z, [self._signs]))
        return Tableau.from_rows(x, z, signs)

    @property
    def qubits(self) -> int:
        return len(self._x)

    @property
    def nbytes(self) -> int:
        """Return the memory of 2n + 1 integers of 2n bits, in bytes, whatever their values."""
        columns = 2 * self.qubits + 1
        return columns * (1 << columns - 1).__sizeof__()

    def __str__(self) -> str:
        return str(self.as_tableau())

    def generators(self) -> Generators:
        return self.as_tableau().generators()

    def h(self, qubit: int) -> None:
        x, z = self._x[qubit], self._z[qubit]
        self._signs ^= x & z
        self._x[qubit], self._z[qubit] = z, x

    def s(self, qubit: int) -> None:
        x, z = self._x[qubit], self._z[qubit]
        self._signs ^= x & z
        self._z[qubit] = x ^ z

    def s_dag(self, qubit: int) -> None:
        x, z = self._x[qubit], self._z[qubit]
        self._signs ^= x & ~z
        self._z[qubit] = x ^ z

    def cx(self, control: int, target: int) -> None:
        x, z = self._x, self._z
        control_x, target_z = x[control], z[target]
        if both := control_x & target_z:
            self._signs ^= both & ~(x[target] ^ z[control])
        x[target] ^= control_x
        z[control] ^= target_z

    def cz(self, control: int, target: int) -> None:
        x, z = self._x, self._z
        control_x, target_x = x[control], x[target]
        if both := control_x & target_x:
            self._signs ^= both & (z[control] ^ z[target])
        z[control] ^= target_x
        z[target] ^= control_x

    def pauli(self, qubit: int, paulis: Bytes) -> None:
        if paulis[0] & 1:
            self._signs ^= self._z[qubit]
        if paulis[0] & 2:
            self._signs ^= self._x[qubit]

    def measure(self, qubit: int, randomness: Randomness) -> tuple[Bytes, bool]:
        if self.is_determined(qubit):
            return np.array([self.value(qubit)], dtype=np.uint8), True
        bits = randomness.bits().copy()
        self.collapse(qubit, int(bits[0]))
        return bits, False

    def is_determined(self, qubit: int) -> bool:
        return not self._x[qubit] >> len(self._x)

    def value(self, qubit: int) -> int:
        """Return the outcome of Z, which must be certain: a product of stabilizers and its sign."""
        count = len(self._x)
        rows = self._x[qubit] << count
        minus = (self._signs & rows).bit_count()
        if rows & (rows - 1):  # more than one stabilizer
            turns = 0  # by i
            for x, z in zip(self._x, self._z, strict=True):
                if (x := x & rows) and (z := z & rows):
                    turns += (x & z).bit_count()
                    minus += (x & _parity_below(z, count)).bit_count()
            minus += turns >> 1
        return minus & 1

    def collapse(self, qubit: int, bit: int) -> None:
        """Project onto an outcome of Z that is not certain.

        A stabilizer that anticommutes with Z is multiplied into the other rows that do, then
        becomes its partner. Powers of i are counted modulo 4, in two bits: odd and high.
        """
        columns_x, columns_z = self._x, self._z
        count, rows = len(columns_x), columns_x[qubit]
        stabilizers = rows >> count
        partner = stabilizers & -stabilizers
        pivot = partner << count
        rows &= ~partner  # the pivot itself included, which so becomes empty
        odd = high = 0
        for index, x in enumerate(columns_x):
            z = columns_z[index]
            if x & partner:
                columns_x[index] = x ^ partner
            if z & partner:
                columns_z[index] = z ^ partner
            if x & pivot:
                columns_x[index] = x ^ rows | partner
                if z & pivot:
                    turned, back = (x ^ z) & rows, z & ~x & rows
                    columns_z[index] = z ^ rows | partner
                else:
                    turned = z & rows
                    back = turned & x
            elif z & pivot:
                turned = x & rows
                back = turned & ~z
                columns_z[index] = z ^ rows | partner
            else:
                continue
            high ^= (odd & turned) ^ back
            odd ^= turned
        signs = self._signs ^ high
        if signs & pivot:
            signs ^= rows
        self._signs = signs | pivot if bit else signs & ~pivot
        columns_z[qubit] |= pivot

    def discard(self, qubit: int) -> None:
        rows = self._x[qubit]
        if not self.is_determined(qubit):
            raise ValueError(f"qubit {qubit} is not in a state of Z: measure it first")
        partner = rows & -rows
        pivot = partner << self.qubits
        if self.value(qubit):  # the pivot is made Z of the qubit alone, and multiplied away
            self._signs ^= self._z[qubit]
        others = rows ^ partner
        for columns in (self._x, self._z):
            del columns[qubit]
            for index, column in enumerate(columns):
                if column & partner:
                    column ^= others
                columns[index] = _without(_without(column, pivot), partner)
        self._signs = _without(_without(self._signs, pivot), partner)

    def tensor(self, other: Self) -> Self:
        ours, theirs = self.qubits, other.qubits

        def ours_in(column: int) -> int:
            return (column & ((1 << ours) - 1)) | (column >> ours << (ours + theirs))

        def theirs_in(column: int) -> int:
            low = column & ((1 << theirs) - 1)
            return (low << ours) | (column >> theirs << (2 * ours + theirs))

        return self._of(
            [*map(ours_in, self._x), *map(theirs_in, other._x)],
            [*map(ours_in, self._z), *map(theirs_in, other._z)],
            ours_in(self._signs) | theirs_in(other._signs),
        )

    def take(self, members: NDArray[np.intp]) -> Self:
        """Return a copy; members must be its only one."""
        if members.tolist() != [0]:
            raise ValueError(f"members {members.tolist()}: there is member 0 alone")
        return self._of(self._x.copy(), self._z.copy(), self._signs)

    def factor(self) -> list[tuple[list[int], Self]]:
        if self.qubits == 1:
            return [([0], self)]
        parts = self.as_tableau().factor()
        if len(parts) == 1:
            return [(parts[0][0], self)]
        return [(qubits, self.from_tableau(part)) for qubits, part in parts]


def _parity_below(bits: int, places: int) -> int:
    """Return for each place whether the bits below it are odd in number."""
    shift = 1
    while shift < places:
        bits ^= bits << shift
        shift <<= 1
    return bits << 1


def _without(bits: int, place: int) -> int:
    """Remove the bit at a place, given as a power of two."""
    return (bits & (place - 1)) | (bits >> 1 & -place)


def _integers(columns: Bits | Bytes) -> list[int]:
    packed = np.packbits(columns, axis=0, bitorder="little").T
    return [int.from_bytes(column.tobytes(), "little") for column in packed]


def _bits(columns: list[int], rows: int) -> Bits:
    size = (rows + 7) // 8
    packed = np.frombuffer(b"".join(c.to_bytes(size, "little") for c in columns), np.uint8)
    bits = np.unpackbits(packed.reshape(len(columns), size), axis=1, count=rows, bitorder="little")
    return bits.T.astype(bool)
