"""A circuit: what both readers make and the interpreter runs."""

from dataclasses import dataclass

MAX_SOURCE_BYTES = 1 << 20
MAX_QUBITS = 1_000
MAX_BITS = 4_096
MAX_OPERATIONS = 200_000  # with gate definitions and registers written out
MAX_SHOTS = 1_000_000


class CircuitError(Exception):
    """A circuit that cannot be read or run; the message names place, value and remedy."""


@dataclass(frozen=True, slots=True)
class Gate:
    """A gate by its name: I, X, Y, Z, H, S, S_DAG, T, T_DAG, RX, RY, RZ, CX or CZ."""

    name: str
    qubits: tuple[int, ...]
    angle_rad: float = 0.0  # of RX, RY and RZ


@dataclass(frozen=True, slots=True)
class Measure:
    """Measure Z of a qubit, which stays, into a classical bit."""

    qubit: int
    bit: int


@dataclass(frozen=True, slots=True)
class Reset:
    """Put a qubit into |0> whatever its state."""

    qubit: int


@dataclass(frozen=True, slots=True)
class Barrier:
    """Nothing to a simulation."""

    qubits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class If:
    """Operations for the shots in which a classical register has a value just now."""

    register: "ClassicalRegister"
    value: int
    operations: "tuple[Operation, ...]"


Operation = Gate | Measure | Reset | Barrier | If


@dataclass(frozen=True, slots=True)
class ClassicalRegister:
    """Bits under one name; bit 0 is the least significant of its value."""

    name: str
    first: int  # its bit 0 among all bits of the circuit
    size: int


@dataclass(frozen=True, slots=True)
class Circuit:
    """Qubits, classical registers, and what is done to them in order."""

    qubits: int
    registers: tuple[ClassicalRegister, ...]
    operations: tuple[Operation, ...]

    @property
    def bits(self) -> int:
        """Return how many classical bits there are."""
        return sum(register.size for register in self.registers)
