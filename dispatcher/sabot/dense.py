"""State vectors of a few qubits, for what a stabilizer state cannot hold.

Amplitude i of a member belongs to the basis state whose qubit q is bit q of i.
"""

from itertools import combinations
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot import kraus
from dispatcher.sabot.backend import Angle, Backend, Bytes, GateName, Generators, Randomness
from dispatcher.sabot.gates import RotationName, as_rotation

MAX_QUBITS = 12  # of one component
MAX_AMPLITUDES = 1 << 22  # of all components together: 64 MiB

DIGITS = 12  # of a probability; what differs by less is rounding
TOLERANCE = 1e-9  # of amplitudes, to distinguish a product from an entangled state

Amplitudes = NDArray[np.complex128]

HADAMARD: Amplitudes = np.array([[1, 1], [1, -1]], dtype=np.complex128) / np.sqrt(2)


class TooLarge(Exception):
    """A state vector beyond the limits; the message names size, limit and remedy."""


class NoBits:
    """Randomness that makes every open outcome 0."""

    def __init__(self, members: int) -> None:
        self._members = members

    def bits(self) -> Bytes:
        return np.zeros(self._members, dtype=np.uint8)

    def uniform(self) -> NDArray[np.float64]:
        return np.zeros(self._members)


class Dense:
    """State vectors of n qubits, one for each of k members."""

    NAME: ClassVar[str] = "dense"

    def __init__(self, qubits: int, members: int = 1) -> None:
        self._qubits = qubits
        self._amplitudes: Amplitudes = np.zeros((members, 1 << qubits), dtype=np.complex128)
        self._amplitudes[:, 0] = 1

    @classmethod
    def _of(cls, qubits: int, amplitudes: Amplitudes) -> Self:
        state = cls(0, 0)
        state._qubits, state._amplitudes = qubits, np.ascontiguousarray(amplitudes)
        return state

    @classmethod
    def from_stabilizers(cls, state: Backend) -> Self:
        """Return the state vectors of a stabilizer state, which stays as it is.

        A basis state that the state contains is projected onto each stabilizer's +1 space.
        """
        members = np.arange(state.members)
        probe, zeros = state.take(members), NoBits(state.members)
        choices = np.zeros(state.members, dtype=np.int64)
        for qubit in range(state.qubits):
            bits, _determined = probe.measure(qubit, zeros)
            choices |= bits.astype(np.int64) << qubit
        dense = cls(state.qubits, state.members)
        dense._amplitudes[:, 0] = 0
        dense._amplitudes[members, choices] = 1
        x, z, signs = state.generators()
        for row, minus in enumerate(signs):
            dense._project(_mask(x[row]), _mask(z[row]), minus)
        dense._normalize()
        return dense

    @property
    def qubits(self) -> int:
        return self._qubits

    @property
    def members(self) -> int:
        return len(self._amplitudes)

    @property
    def nbytes(self) -> int:
        return self._amplitudes.nbytes

    @property
    def amplitudes(self) -> Amplitudes:
        """Return a copy of the state vectors, shape (k, 2^n); their phases mean nothing."""
        return self._amplitudes.copy()

    def generators(self) -> Generators:
        """Raise ValueError: a state vector has none in general."""
        raise ValueError("a state vector has no stabilizers; ask for its amplitudes")

    def gate(self, name: GateName, *qubits: int, angle_rad: Angle = 0.0) -> None:
        """Apply the gate of that name to every member; the angle is for RX, RY and RZ.

        Each member may have an angle of its own, shape (k,).
        """
        rotation = as_rotation(name, angle_rad)
        match name, qubits:
            case _, (qubit,) if rotation is not None:
                self._apply(qubit, _rotation(*rotation))
            case "H", (qubit,):
                self._apply(qubit, HADAMARD)
            case "S", (qubit,):
                self._halves(qubit)[1][:] *= 1j
            case "S_DAG", (qubit,):
                self._halves(qubit)[1][:] *= -1j
            case "CX", (control, target):
                index = self._index
                self._amplitudes = self._amplitudes.take(
                    index ^ ((index >> control & 1) << target), axis=1
                )
            case "CZ", (control, target):
                both = (self._index >> control) & (self._index >> target) & 1
                self._amplitudes *= 1 - 2 * both
            case _:
                raise ValueError(f"gate {name} does not act on {len(qubits)} qubits")

    def pauli(self, qubit: int, paulis: Bytes) -> None:
        zero, one = self._halves(qubit)
        one[paulis > 1] *= -1
        flipped = (paulis & 1).astype(bool)
        zero[flipped], one[flipped] = one[flipped], zero[flipped]

    def kraus(
        self,
        qubit: int,
        operators: Amplitudes,
        met: NDArray[np.bool_],
        randomness: Randomness,
    ) -> None:
        """Let a qubit of the members that it meets undergo one of these operators, drawn.

        They have shape (m, 2, 2), or (k, m, 2, 2): those of each member.
        """
        halves = self._halves(qubit)
        density = np.empty((self.members, 2, 2), dtype=np.complex128)
        for row, one in enumerate(halves):
            for column, other in enumerate(halves):
                density[:, row, column] = np.sum(one * other.conj(), axis=(1, 2))
        uniform = randomness.uniform() if operators.shape[-3] > 1 else None
        matrices = np.tile(np.eye(2, dtype=np.complex128), (self.members, 1, 1))
        matrices[met] = kraus.drawn(operators, density, uniform)[met]
        self._apply(qubit, matrices.transpose(1, 2, 0))
        self._normalize()

    def measure(self, qubit: int, randomness: Randomness) -> tuple[Bytes, bool]:
        zero, one = self._halves(qubit)
        weights = [np.sum(np.abs(half) ** 2, axis=(1, 2)) for half in (zero, one)]
        probability = np.round(weights[1] / (weights[0] + weights[1]), DIGITS)
        determined = bool(((probability == 0) | (probability == 1)).all())
        bits = (probability if determined else randomness.uniform() >= 1 - probability).astype(
            np.uint8
        )
        zero[bits == 1] = 0
        one[bits == 0] = 0
        self._normalize()
        return bits, determined

    def discard(self, qubit: int) -> None:
        zero, one = self._halves(qubit)
        if (zero.any(axis=(1, 2)) & one.any(axis=(1, 2))).any():
            raise ValueError(f"qubit {qubit} is not in a state of Z: measure it first")
        self._amplitudes = (zero + one).reshape(self.members, -1)
        self._qubits -= 1

    def tensor(self, other: Self) -> Self:
        joint = other._amplitudes[:, :, None] * self._amplitudes[:, None, :]
        return self._of(self.qubits + other.qubits, joint.reshape(self.members, -1))

    def take(self, members: NDArray[np.intp]) -> Self:
        return self._of(self.qubits, self._amplitudes[members])

    def factor(self) -> list[tuple[list[int], Self]]:
        if self.qubits == 1:
            return [([0], self)]
        groups, left = [], list(range(self.qubits))
        relative = self._relative()
        while left:
            group = _smallest_part(relative, left)
            groups.append(group)
            left = [qubit for qubit in left if qubit not in group]
        if len(groups) == 1:
            return [(groups[0], self)]
        return [(group, self._part(group, relative)) for group in groups]

    @property
    def _index(self) -> NDArray[np.int64]:
        return np.arange(1 << self.qubits)

    def _halves(self, qubit: int) -> tuple[Amplitudes, Amplitudes]:
        """Return views of the amplitudes where a qubit is 0 and where it is 1."""
        view = self._amplitudes.reshape(self.members, -1, 2, 1 << qubit)
        return view[:, :, 0], view[:, :, 1]

    def _apply(self, qubit: int, matrix: Amplitudes) -> None:
        """Apply a matrix of shape (2, 2), or (2, 2, k): one for each member."""
        zero, one = self._halves(qubit)
        zero[:], one[:] = (row[0] * zero + row[1] * one for row in matrix.reshape(2, 2, -1, 1, 1))

    def _project(self, x: int, z: int, minus: Bytes) -> None:
        """Project member j onto the space where a Pauli string is +1, or -1 if minus[j]."""
        index = self._index ^ x  # the amplitude that comes to each place
        phases = 1j ** (x & z).bit_count() * (1 - 2 * _parity(index & z))
        signs = 1 - 2 * minus.astype(np.int64)
        self._amplitudes = self._amplitudes + signs[:, None] * phases * self._amplitudes.take(
            index, axis=1
        )

    def _normalize(self) -> None:
        norms = np.sqrt(np.sum(np.abs(self._amplitudes) ** 2, axis=1))
        self._amplitudes /= norms[:, None]

    def _relative(self) -> Amplitudes:
        """Return amplitudes as multiples of each member's largest, which comes first.

        Place i holds that of the basis state which differs from the largest one's by i.
        """
        members = np.arange(self.members)
        largest = np.abs(self._amplitudes).argmax(axis=1)
        moved: Amplitudes = self._amplitudes[members[:, None], self._index ^ largest[:, None]]
        moved /= moved[:, :1].copy()
        return moved

    def _part(self, group: list[int], relative: Amplitudes) -> Self:
        largest = np.abs(self._amplitudes).argmax(axis=1)
        inner = np.arange(1 << len(group))
        spread = sum((inner >> place & 1) << qubit for place, qubit in enumerate(group))
        offset = sum((largest >> qubit & 1) << place for place, qubit in enumerate(group))
        moved = relative[:, spread]
        members = np.arange(self.members)
        part = self._of(len(group), moved[members[:, None], inner ^ offset[:, None]])
        part._normalize()
        return part


def _smallest_part(relative: Amplitudes, qubits: list[int]) -> list[int]:
    """Return the first of these qubits with the fewest others it needs to be a part.

    In a product each amplitude, relative to the largest, is that of either part multiplied.
    """
    first, *others = qubits
    index = np.arange(relative.shape[1])
    for size in range(len(others)):
        for chosen in combinations(others, size):
            inside = sum(1 << qubit for qubit in (first, *chosen))
            for rows in (relative[:1], relative):  # the first member alone says no soonest
                product = rows[:, index & inside] * rows[:, index & ~inside]
                if np.abs(product - rows).max() > TOLERANCE:
                    break
            else:
                return [first, *chosen]
    return qubits


def _rotation(name: RotationName, angle_rad: Angle) -> Amplitudes:
    """Return exp(-i angle/2 P) of the axis in the rotation's name; shape (2, 2) or (2, 2, k)."""
    half = np.asarray(angle_rad, dtype=np.float64) / 2
    c, s, none = np.cos(half), np.sin(half), np.zeros_like(half)
    rows = {
        "RX": [[c, -1j * s], [-1j * s, c]],
        "RY": [[c, -s], [s, c]],
        "RZ": [[c - 1j * s, none], [none, c + 1j * s]],
    }
    return np.array(rows[name], dtype=np.complex128)


def _mask(row: NDArray[np.bool_]) -> int:
    return sum(1 << int(qubit) for qubit in np.flatnonzero(row))


def _parity(values: NDArray[np.int64]) -> NDArray[np.int64]:
    for shift in (8, 4, 2, 1):
        values = values ^ (values >> shift)
    return values & 1
