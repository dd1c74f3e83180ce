"""Programs of the original CHP."""

import pytest

from applications.circuits.circuit import (
    Circuit,
    CircuitError,
    ClassicalRegister,
    Gate,
    Measure,
    Source,
)
from applications.circuits.reading import read_chp
from dispatcher.recording.writer import MAX_QUBITS


def read(text: str) -> Circuit:
    """Read a program."""
    return read_chp(Source("program.chp", text))


def test_the_comment_ends_at_the_first_hash() -> None:
    assert read("c 0 1 is no\ninstruction #\nh 0\nc 0 3\n\np 3\nm 3\nm 0\n") == Circuit(
        4,
        (ClassicalRegister("m", 0, 2),),
        (Gate("H", (0,)), Gate("CX", (0, 3)), Gate("S", (3,)), Measure(3, 0), Measure(0, 1)),
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("h 0\n", "program.chp:1:1: no # ends the opening comment"),
        ("#\n", "program.chp:1:1: no instruction"),
        ("a\nb #\nh 0\nx 0", "program.chp:4:1: unknown instruction 'x'"),
        ("#\nc 0", "program.chp:2:1: c takes 2 qubits, not 1"),
        ("#\nh 0 1", "program.chp:2:1: h takes 1 qubits, not 2"),
        ("#\nc 1 1", "program.chp:2:1: c is given the same qubit twice"),
        ("#\nh -1", "program.chp:2:1: '-1' is not a qubit"),
        ("#\nh ²", "program.chp:2:1: '²' is not a qubit"),
        (f"#\nh {MAX_QUBITS}", "program.chp:2:1: qubit 1000 exceeds the limit of 1,000"),
        ("#\nh " + "9" * 5000, "is not a qubit"),
        ("#\n" + "m 0\n" * 4097, "program.chp:4098:1: more than 4,096 measurements"),
        ("#\n" + "h 0\n" * 200_001, "program.chp:200002:1: more than 200,000 instructions"),
    ],
)
def test_an_error_names_its_line(text: str, problem: str) -> None:
    with pytest.raises(CircuitError) as raised:
        read(text)
    assert problem in str(raised.value)
