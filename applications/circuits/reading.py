"""The choice of a reader for a program, and counts of the values in its registers.

Programs of the original CHP (Aaronson and Gottesman, quant-ph/0406196).

Text up to the first # is a comment. Then each line is one instruction, with qubits numbered
from 0: `c a b` (controlled NOT from a to b), `h a`, `p a` (phase gate S), `m a` (measure).
"""

from collections import Counter
from collections.abc import Iterable
from typing import Literal

import numpy as np

from applications.circuits.circuit import (
    MAX_OPERATIONS,
    Circuit,
    ClassicalRegister,
    Gate,
    Measure,
    Operation,
    Source,
)
from applications.circuits.qasm import read_qasm
from dispatcher.recording.writer import MAX_BITS, MAX_QUBITS
from dispatcher.sabot.backend import Bytes

GATES = {"c": ("CX", 2), "h": ("H", 1), "p": ("S", 1), "m": ("measure", 1)}
REGISTER = "m"
LONGEST_WORD = 20


def read_chp(source: Source) -> Circuit:
    """Return the circuit; the k-th measurement goes to bit k of register m."""
    comment, mark, body = source.text.partition("#")
    if not mark:
        source.fail(1, 1, "no # ends the opening comment; put one before the first instruction")
    operations: list[Operation] = []
    measured = qubits = 0
    for line, text in enumerate(body.split("\n"), start=comment.count("\n") + 1):
        words = text.split()
        if not words:
            continue
        if len(operations) == MAX_OPERATIONS:
            source.fail(line, 1, f"more than {MAX_OPERATIONS:,} instructions; shorten the program")
        operands = _operands(source, line, words)
        qubits = max(qubits, *(qubit + 1 for qubit in operands))
        if words[0] != "m":
            operations.append(Gate(GATES[words[0]][0], operands))
            continue
        if measured == MAX_BITS:
            source.fail(line, 1, f"more than {MAX_BITS:,} measurements; shorten the program")
        operations.append(Measure(operands[0], measured))
        measured += 1
    if not operations:
        source.fail(1, 1, "no instruction after the #; write c a b, h a, p a or m a in lines")
    registers = (ClassicalRegister(REGISTER, 0, measured),) if measured else ()
    return Circuit(qubits, registers, tuple(operations))


def _operands(source: Source, line: int, words: list[str]) -> tuple[int, ...]:
    name, *numbers = words
    if name not in GATES:
        short = name[:LONGEST_WORD]
        source.fail(line, 1, f"unknown instruction {short!r}; use c a b, h a, p a or m a")
    if len(numbers) != GATES[name][1]:
        source.fail(line, 1, f"{name} takes {GATES[name][1]} qubits, not {len(numbers)}")
    for number in numbers:
        if not (number.isascii() and number.isdigit() and len(number) <= LONGEST_WORD):
            source.fail(line, 1, f"{number[:LONGEST_WORD]!r} is not a qubit; number them from 0")
        if int(number) >= MAX_QUBITS:
            source.fail(line, 1, f"qubit {number} exceeds the limit of {MAX_QUBITS:,} qubits")
    operands = tuple(int(number) for number in numbers)
    if len(set(operands)) < len(operands):
        source.fail(line, 1, f"{name} is given the same qubit twice; give it different ones")
    return operands


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
    texts = [(_text(circuit, packed), number) for packed, number in counts.items()]
    return sorted(texts, key=lambda each: (-each[1], each[0]))


def _text(circuit: Circuit, packed: bytes) -> str:
    bits = np.unpackbits(np.frombuffer(packed, dtype=np.uint8), count=circuit.bits)
    values_of_registers = []
    for register in circuit.registers:
        values = bits[register.first : register.first + register.size]
        values_of_registers.append("".join(map(str, values[::-1].tolist())))
    return " ".join(values_of_registers)
