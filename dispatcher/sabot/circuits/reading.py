"""The choice of a reader for a program, and counts of the values in its registers."""

from collections import Counter
from collections.abc import Iterable
from typing import Literal

import numpy as np

from dispatcher.sabot.backend import Bytes
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


def count(circuit: Circuit, batches: Iterable[Bytes]) -> list[tuple[str, int]]:
    """Return the values found and how often, the most frequent first, then by value.

    A value is written as bits, the highest of a register first, registers in the order of their
    declaration with a space between them.
    """
    counts: Counter[bytes] = Counter()
    for bits in batches:
        packed = np.packbits(bits, axis=0)
        values, numbers = np.unique(packed, axis=1, return_counts=True)
        for column, number in zip(values.T, numbers.tolist(), strict=True):
            counts[column.tobytes()] += number
    found = [(_text(circuit, packed), number) for packed, number in counts.items()]
    return sorted(found, key=lambda each: (-each[1], each[0]))


def _text(circuit: Circuit, packed: bytes) -> str:
    bits = np.unpackbits(np.frombuffer(packed, dtype=np.uint8), count=circuit.bits)
    words = []
    for register in circuit.registers:
        own = bits[register.first : register.first + register.size]
        words.append("".join(map(str, own[::-1].tolist())))
    return " ".join(words)
