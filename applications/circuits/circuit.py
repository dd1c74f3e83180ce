"""A circuit: what both readers make and the interpreter runs."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from dispatcher.recording.writer import MAX_SOURCE_BYTES

STANDARD_INPUT = "-"


@dataclass(frozen=True)
class Source:
    """A text and the name that errors give it."""

    name: str
    text: str

    def fail(self, line: int, column: int, problem: str) -> NoReturn:
        """Raise CircuitError for a place in the text, both counted from 1."""
        raise CircuitError(f"{self.name}:{line}:{column}: {problem}")


def read_source(path: str) -> Source:
    """Read a file, or standard input for "-"; CircuitError if it is not text or too long."""
    name = "standard input" if path == STANDARD_INPUT else path
    try:
        if path == STANDARD_INPUT:
            content = sys.stdin.buffer.read(MAX_SOURCE_BYTES + 1)
        else:
            with Path(path).open("rb") as file:
                content = file.read(MAX_SOURCE_BYTES + 1)
    except OSError as error:
        raise CircuitError(f"cannot read {name}: {error.strerror}") from error
    if len(content) > MAX_SOURCE_BYTES:
        raise CircuitError(
            f"{name} is longer than {MAX_SOURCE_BYTES:,} bytes; divide it or use gate definitions"
        )
    try:
        return Source(name, content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise CircuitError(
            f"{name} is not text: byte {error.start} is {error.object[error.start]:#04x}; give a "
            "program in OpenQASM 2.0 or .chp"
        ) from error


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
        return sum(register.size for register in self.registers)
