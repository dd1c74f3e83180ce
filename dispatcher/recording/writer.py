"""The file of a dump: lines of OpenQASM 2.0, qubits that are used again, and limits."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TextIO

# Limits of a program that `qmn sabot` runs.
MAX_SOURCE_BYTES = 1 << 20
MAX_QUBITS = 1_000
MAX_BITS = 4_096
PHOTONS = 64  # of each block are written, from the first on
FULL_BYTES = MAX_SOURCE_BYTES // 2  # no block begins behind that; those that have may go on

HEADER = f"""OPENQASM 2.0;
include "qelib1.inc";
// The operations on the first {PHOTONS} photons of each block, with their noise made explicit.
// Run it: qmn sabot run FILE --shots 1. A comment says where each line comes from; behind a
// measurement it has the outcome. A lost photon is reset and not measured any more.
// The clicks of detectors and Bell analysers, and the drift of pairs, are in the event log.
"""


@dataclass(eq=False)
class Chunk:
    """A quantum register of the file, for the photons of one block's half."""

    name: str
    size: int
    live: set[int] = field(default_factory=set)

    def qubit(self, index: int) -> str:
        return f"{self.name}[{index}]"


class QasmWriter:
    """Writes a dump that `qmn sabot run` takes, as far as its limits allow."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._chunks: list[Chunk] = []
        self._registers = self._promised_bits = self._written = 0
        self._full = False
        self._write(HEADER)

    def begin(self, sizes: Iterable[int], origin: str) -> list[Chunk] | None:
        """Return qubits in |0> for registers of these sizes; None if the file is full."""
        limited = [min(size, PHOTONS) for size in sizes]
        if not self._has_capacity(limited):
            if not self._full:
                self.comment("the file is full: blocks that are made from here on are left out")
            self._full = True
            return None
        self._promised_bits += sum(limited)
        self.comment(origin)
        return [self._chunk(size) for size in limited]

    def line(self, text: str, comment: str = "") -> None:
        self._write(f"{text} // {_one_line(comment)}\n" if comment else f"{text}\n")

    def comment(self, text: str) -> None:
        self._write(f"// {_one_line(text)}\n")

    def bits(self, size: int, comment: str) -> str:
        """Declare a classical register; return its name."""
        name = f"c{self._registers}"
        self._registers += 1
        self.line(f"creg {name}[{size}];", comment)
        return name

    def _has_capacity(self, sizes: list[int]) -> bool:
        declared = sum(chunk.size for chunk in self._chunks)
        new = sum(size for size in sizes if self._free(size) is None)
        return (
            self._written < FULL_BYTES
            and declared + sum(sizes if new else ()) <= MAX_QUBITS
            and self._promised_bits + sum(sizes) <= MAX_BITS
        )

    def _free(self, size: int) -> Chunk | None:
        return next((c for c in self._chunks if not c.live and c.size == size), None)

    def _chunk(self, size: int) -> Chunk:
        chunk = self._free(size)
        if chunk is None:
            chunk = Chunk(f"q{len(self._chunks)}", size)
            self._chunks.append(chunk)
            self.line(f"qreg {chunk.name}[{size}];")
        else:
            self.line(f"reset {chunk.name};", "used again")
        chunk.live = set(range(size))
        return chunk

    def _write(self, text: str) -> None:
        self._file.write(text)
        self._written += len(text)


def _one_line(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)
