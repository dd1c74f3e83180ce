"""Counts of the values found in the classical registers of a circuit."""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.circuits.circuit import Circuit


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
