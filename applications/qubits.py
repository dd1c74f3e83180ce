"""Qubits for programs on hosts, who need not know NetQASM: a Python face of the processing unit.

with Processor() as processor:           # of the host that the program runs on
    (half,) = processor.create_pairs("bob")
    half.h()
    print(half.measure())

At bob the same with `receive_pairs("alice")`. Messages between programs go by TCP, as
anywhere: `processor.nodes` has the addresses. Gates are gathered until an outcome is wanted.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Self

from applications.processing_unit.messages import (
    InitApplication,
    OpenSocket,
    ReturnedRegister,
    encode_host_message,
)
from applications.processing_unit.processing_socket import ProcessingSocket
from applications.processing_unit.subroutine import Instruction, Subroutine
from wire.parameters.checks import remedy

MOST_QUBITS = 255
R = range(16)  # NetQASM's registers, by their numbers
QUBIT, OTHER, OUTCOME = 32, 33, 48  # Q0, Q1, M0
NUMBERS, WORDS, DESCRIPTIONS = range(3)  # arrays: of qubits, of a request, of its pairs
WORDS_OF_A_PAIR, WORDS_OF_A_REQUEST = 10, 22
KEEP = 0


class Qubit:
    """A qubit of this host; used up when it is measured or freed."""

    def __init__(self, processor: "Processor", number: int) -> None:
        self._processor, self.number = processor, number

    def x(self) -> None:
        """Flip it."""
        self._gate("x")

    def y(self) -> None:
        """Do Y."""
        self._gate("y")

    def z(self) -> None:
        """Flip its phase."""
        self._gate("z")

    def h(self) -> None:
        """Do a Hadamard gate."""
        self._gate("h")

    def s(self) -> None:
        """Do S, a quarter turn about Z."""
        self._gate("s")

    def t(self) -> None:
        """Do T, an eighth turn about Z."""
        self._gate("t")

    def rotate(self, axis: str, numerator: int, denominator: int) -> None:
        """Turn it about "x", "y" or "z", by numerator pi / 2^denominator; both are 0 to 255."""
        self._gate(f"rot_{axis}", numerator, denominator)

    def cnot(self, target: "Qubit") -> None:
        """Flip another qubit of this host where this one is 1."""
        self._processor.do("set", QUBIT, self.number)
        self._processor.do("set", OTHER, target.number)
        self._processor.do("cnot", QUBIT, OTHER)

    def cz(self, other: "Qubit") -> None:
        """Flip the phase where this one and another qubit of this host are 1."""
        self._processor.do("set", QUBIT, self.number)
        self._processor.do("set", OTHER, other.number)
        self._processor.do("cphase", QUBIT, OTHER)

    def measure(self) -> int:
        """Return 0 or 1, as found along Z; the qubit is used up."""
        (outcome,) = self._processor.measure([self])
        return outcome

    def _gate(self, name: str, *operands: int) -> None:
        self._processor.do("set", QUBIT, self.number)
        self._processor.do(name, QUBIT, *operands)


class Processor:
    """A program's access to the processing unit of its host; all its qubits go when it closes."""

    def __init__(self, stack: Path | str | None = None) -> None:
        """Connect to the host's stack (QMN_STACK); raise QuantumSocketError if there is none."""
        self._socket = ProcessingSocket(stack)
        self.nodes = self._socket.begin()  # addresses by name, this host included
        self.node: str = self._socket.summary["node"]  # this host
        self._socket.send(encode_host_message(InitApplication(0, MOST_QUBITS)))
        self._open: set[tuple[str, int]] = set()
        self._free = list(reversed(range(MOST_QUBITS)))
        self._instructions: list[Instruction] = []

    def qubit(self) -> Qubit:
        (qubit,) = self._new(1)
        self.do("set", QUBIT, qubit.number)
        self.do("qalloc", QUBIT)
        self.do("init", QUBIT)
        return qubit

    def create_pairs(self, host: str, count: int = 1, channel: int = 0) -> list[Qubit]:
        """Return this host's halves of pairs Phi+ with another, whose program receives them.

        Channels tell what several programs of two hosts share.
        """
        request = ((0, KEEP), (1, count))
        return self._pairs(host, count, channel, "create_epr", request)

    def receive_pairs(self, host: str, count: int = 1, channel: int = 0) -> list[Qubit]:
        """Return this host's halves of pairs Phi+ that a program of another host creates."""
        return self._pairs(host, count, channel, "recv_epr", ())

    def measure(self, qubits: Sequence[Qubit]) -> list[int]:
        """Return 0 or 1 of each, as found along Z, all at once; the qubits are used up."""
        for qubit in qubits:
            self.do("set", QUBIT, qubit.number)
            self.do("meas", QUBIT, OUTCOME)
            self.do("qfree", QUBIT)
            self.do("ret_reg", OUTCOME)
        outcomes = self.flush()
        self._free += [qubit.number for qubit in qubits]
        return outcomes

    def flush(self) -> list[int]:
        """Have everything done that was asked for; return the outcomes."""
        instructions, self._instructions = tuple(self._instructions), []
        if not instructions:
            return []
        answers = self._socket.send(encode_host_message(Subroutine(0, instructions)))
        return [answer.value for answer in answers if isinstance(answer, ReturnedRegister)]

    def do(self, name: str, *operands: int) -> None:
        """Gather an instruction."""
        self._instructions.append(Instruction(name, operands))

    def close(self) -> None:
        """Close the connection; its qubits are discarded."""
        self._socket.close()

    def _new(self, count: int) -> list[Qubit]:
        if not 0 < count <= len(self._free):
            raise ValueError(f"{count} qubits: {len(self._free)} of {MOST_QUBITS} are free")
        return [Qubit(self, self._free.pop()) for _ in range(count)]

    def _pairs(
        self, host: str, count: int, channel: int, name: str, words: Iterable[tuple[int, int]]
    ) -> list[Qubit]:
        if host not in self.nodes:
            raise ValueError(f"host {host!r}: {remedy(host, self.nodes)}")
        node, qubits = list(self.nodes).index(host), self._new(count)
        if (host, channel) not in self._open:
            self._socket.send(encode_host_message(OpenSocket(0, channel, node, channel)))
            self._open.add((host, channel))
        self._array(NUMBERS, count, enumerate(qubit.number for qubit in qubits))
        self._array(DESCRIPTIONS, count * WORDS_OF_A_PAIR, ())
        if words:
            self._array(WORDS, WORDS_OF_A_REQUEST, words)
        self.do("set", R[0], node)
        self.do("set", R[1], channel)
        self.do("set", R[2], NUMBERS)
        self.do("set", R[3], WORDS)
        self.do("set", R[4], DESCRIPTIONS)
        registers = R[:5] if words else (*R[:3], R[4])
        self.do(name, *registers)
        self.do("set", R[5], 0)
        self.do("set", R[6], count * WORDS_OF_A_PAIR)
        self.do("wait_all", DESCRIPTIONS, R[5], R[6])
        self.flush()
        return qubits

    def _array(self, address: int, length: int, values: Iterable[tuple[int, int]]) -> None:
        self.do("set", R[0], length)
        self.do("array", R[0], address)
        for place, value in values:
            self.do("set", R[1], value)
            self.do("set", R[2], place)
            self.do("store", R[1], address, R[2])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
