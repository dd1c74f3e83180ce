"""The choice of a reader for a program."""

from typing import Literal

from dispatcher.sabot.circuits.chp_program import read_chp
from dispatcher.sabot.circuits.circuit import Circuit
from dispatcher.sabot.circuits.qasm import read_qasm
from dispatcher.sabot.circuits.source import Source

Format = Literal["qasm", "chp"]


def read_circuit(source: Source, form: Format | None = None) -> Circuit:
    """Return the circuit of a program, of the format that its name says if none is given.

    Raise CircuitError with the line of what is wrong.
    """
    if form is None:
        form = "chp" if source.name.endswith(".chp") else "qasm"
    return read_chp(source) if form == "chp" else read_qasm(source)
