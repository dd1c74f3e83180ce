"""Texts of circuits, and where in them something is wrong."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from dispatcher.sabot.circuits.circuit import MAX_SOURCE_BYTES, CircuitError

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
