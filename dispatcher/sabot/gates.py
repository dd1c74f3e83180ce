"""The gates by name, and which of them a stabilizer state can undergo.

Gates that are not Clifford gates are rotations exp(-i angle/2 P) about a Pauli axis; T is RZ
by a quarter of pi up to a phase that nobody sees.
"""

from abc import ABC, abstractmethod
from math import pi
from typing import Literal, get_args

from dispatcher.sabot.backend import Angle, CliffordName, GateName

RotationName = Literal["RX", "RY", "RZ"]

CLIFFORDS: tuple[CliffordName, ...] = get_args(CliffordName)
ROTATIONS: tuple[RotationName, ...] = get_args(RotationName)
TWO_QUBIT_GATES = ("CX", "CZ")
THEMSELVES: dict[str, tuple[CliffordName]] = {name: (name,) for name in CLIFFORDS}
EIGHTH_TURNS = {"T": pi / 4, "T_DAG": -pi / 4}

PRECISION = 1e-12  # of an angle in quarter turns, below which it is a whole number of them
QUARTERS: tuple[tuple[CliffordName, ...], ...] = ((), ("S",), ("S", "S"), ("S_DAG",))
AXES: dict[str, tuple[tuple[CliffordName, ...], tuple[CliffordName, ...]]] = {
    "RX": (("H",), ("H",)),
    "RY": (("S_DAG", "H"), ("H", "S")),
    "RZ": ((), ()),
}


def as_clifford(name: GateName, angle_rad: Angle = 0.0) -> tuple[CliffordName, ...] | None:
    """Return Clifford gates that do the same, in order; None if there are none.

    There are none, either, for angles of which each member has its own.
    """
    if name in THEMSELVES:
        return THEMSELVES[name]
    if name not in AXES or not isinstance(angle_rad, float | int):
        return None
    turns = angle_rad / (pi / 2)
    if abs(turns - round(turns)) > PRECISION:
        return None
    before, after = AXES[name]
    return before + QUARTERS[round(turns) % 4] + after


def as_rotation(name: GateName, angle_rad: Angle = 0.0) -> tuple[RotationName, Angle] | None:
    """Return the rotation that a gate is, and its angle; None if it is a Clifford gate."""
    if name in EIGHTH_TURNS:
        return "RZ", EIGHTH_TURNS[name]
    for rotation in ROTATIONS:
        if name == rotation:
            return rotation, angle_rad
    return None


class NamedGates(ABC):
    def gate(self, name: CliffordName, *qubits: int) -> None:
        """Apply the gate of that name to every member; raise ValueError for other counts."""
        match name, qubits:
            case "H", (qubit,):
                self.h(qubit)
            case "S", (qubit,):
                self.s(qubit)
            case "S_DAG", (qubit,):
                self.s_dag(qubit)
            case "CX", (control, target):
                self.cx(control, target)
            case "CZ", (control, target):
                self.cz(control, target)
            case _:
                raise ValueError(f"gate {name} does not act on {len(qubits)} qubits")

    @abstractmethod
    def h(self, qubit: int) -> None:
        """Apply the Hadamard gate."""

    @abstractmethod
    def s(self, qubit: int) -> None:
        """Apply the phase gate."""

    @abstractmethod
    def s_dag(self, qubit: int) -> None:
        """Apply the inverse of the phase gate."""

    @abstractmethod
    def cx(self, control: int, target: int) -> None:
        """Apply the controlled NOT."""

    @abstractmethod
    def cz(self, one: int, other: int) -> None:
        """Apply the controlled Z."""
