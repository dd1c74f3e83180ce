"""From OpenQASM 2.0 (arXiv:1707.03429) to a circuit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn

from applications.circuits.circuit import (
    MAX_OPERATIONS,
    Barrier,
    Circuit,
    ClassicalRegister,
    Gate,
    If,
    Measure,
    Operation,
    Reset,
    Source,
)
from applications.circuits.expressions import BadExpression, evaluate, read_arguments
from applications.circuits.gates import BadGate, standard_gates
from applications.circuits.syntax import Tokens
from dispatcher.recording.writer import MAX_BITS, MAX_QUBITS

HEADER = (
    'begin with the lines OPENQASM 2.0; and include "qelib1.inc"; (or, for a .chp program, say '
    "--format chp)"
)
NOT_IN_2 = (
    "OpenQASM 2.0 has no such statement; use qreg, creg, gate, gates, measure, reset, barrier "
    "and if(c==1)"
)


def read_qasm(source: Source) -> Circuit:
    """Return the circuit of a program; raise CircuitError with its line and column."""
    return _Reader(source).read()


@dataclass(frozen=True, slots=True)
class Operand:
    """A register, or one of its qubits or bits; and where the program names it."""

    name: str
    index: int | None
    position: int


class _Reader:
    def __init__(self, source: Source) -> None:
        self._tokens = Tokens(source)
        self._gates = standard_gates()
        self._quantum: dict[str, range] = {}
        self._classical: dict[str, ClassicalRegister] = {}
        self._qubits = self._bits = self._count = 0
        self._statement_position = 0

    def read(self) -> Circuit:
        self._read_version()
        operations: list[Operation] = []
        while self._tokens.next.kind != "end":
            self._statement_position = self._tokens.next.position
            try:
                operations += self._statement()
            except (BadGate, BadExpression) as error:
                self._fail(str(error))
        if not self._qubits:
            problem = "the program has no qubits; declare some, as with qreg q[2];"
            self._tokens.fail(problem, 0)
        return Circuit(self._qubits, tuple(self._classical.values()), tuple(operations))

    def _read_version(self) -> None:
        if not self._tokens.accept("OPENQASM"):
            self._tokens.fail(f"this is not OpenQASM; {HEADER}", 0)
        version = self._tokens.take().text
        if version not in ("2.0", "2"):
            problem = f"this is OpenQASM {version}; only 2.0 is read: begin with OPENQASM 2.0;"
            self._tokens.fail(problem, 0)
        self._tokens.expect(";")

    def _statement(self) -> Iterator[Operation]:
        match self._tokens.next.text:
            case "include":
                self._include()
            case "qreg":
                name, size = self._declaration("qubits", self._qubits, MAX_QUBITS)
                self._quantum[name] = range(self._qubits, self._qubits + size)
                self._qubits += size
            case "creg":
                name, size = self._declaration("bits", self._bits, MAX_BITS)
                self._classical[name] = ClassicalRegister(name, self._bits, size)
                self._bits += size
            case "gate":
                self._tokens.take()
                self._gates.define(self._tokens)
            case "opaque":
                self._tokens.take()
                self._gates.declare(self._tokens)
            case "if":
                yield self._counted(self._if())
            case _:
                yield from map(self._counted, self._operations())

    def _operations(self) -> Iterator[Gate | Measure | Reset | Barrier]:
        if self._tokens.next.kind != "name" or self._tokens.next.text == "if":
            self._tokens.fail(NOT_IN_2)
        match self._tokens.next.text:
            case "measure":
                yield from self._measure()
            case "reset":
                self._tokens.take()
                operand = self._operand()
                self._tokens.expect(";")
                yield from map(Reset, self._qubits_of(operand))
            case "barrier":
                self._tokens.take()
                yield self._barrier()
            case _:
                yield from self._apply()

    def _counted(self, operation: Operation) -> Operation:
        self._count += 1
        if self._count > MAX_OPERATIONS:
            self._fail(
                f"more than {MAX_OPERATIONS:,} operations, with gates and registers written "
                "out; shorten the program"
            )
        return operation

    def _include(self) -> None:
        self._tokens.take()
        if self._tokens.next.kind != "string":
            self._tokens.unexpected()
        if self._tokens.take().text != '"qelib1.inc"':
            self._fail('only "qelib1.inc" can be included; paste other gates')
        self._tokens.expect(";")

    def _declaration(self, kind: str, declared: int, most: int) -> tuple[str, int]:
        """Read a new register; return its name and size."""
        self._tokens.take()
        name = self._tokens.new_name()
        size = self._tokens.integer() if self._tokens.accept("[") else None
        if not size:
            self._fail(f"register {name!r} needs a size of at least 1, as in {name}[2]")
        self._tokens.expect("]")
        self._tokens.expect(";")
        if name in self._quantum or name in self._classical:
            self._fail(f"register {name!r} exists already; take another name")
        if size > most - declared:
            self._fail(f"{size} more {kind} exceed the limit of {most:,}; use fewer")
        return name, size

    def _apply(self) -> Iterator[Gate]:
        name = self._tokens.name().text
        arguments = read_arguments(self._tokens, ())
        operands = self._operands()
        registers = [self._qubits_of(operand) for operand in operands]
        whole = [
            len(register)
            for register, operand in zip(registers, operands, strict=True)
            if operand.index is None
        ]
        if len(set(whole)) > 1:
            sizes = ", ".join(map(str, whole))
            self._fail(f"registers of {sizes} qubits do not pair up; name qubits")
        angles = [evaluate(argument, {}) for argument in arguments]
        for each in range(whole[0] if whole else 1):
            qubits = (
                register_qubits[each] if len(register_qubits) > 1 else register_qubits[0]
                for register_qubits in registers
            )
            yield from self._gates.apply(name, angles, tuple(qubits))

    def _measure(self) -> Iterator[Measure]:
        self._tokens.take()
        operand = self._operand()
        if not self._tokens.accept("->"):
            self._fail("name the bits to measure into: measure q -> c;")
        target = self._operand()
        self._tokens.expect(";")
        qubits, bits = self._qubits_of(operand), self._bits_of(target)
        if len(qubits) != len(bits):
            problem = f"{len(qubits)} qubits do not fit {len(bits)} bits; measure as many as fit"
            self._tokens.fail(problem, operand.position)
        yield from map(Measure, qubits, bits)

    def _barrier(self) -> Barrier:
        qubits: dict[int, None] = {}
        for operand in self._operands():
            named = dict.fromkeys(self._qubits_of(operand))
            if not qubits.keys().isdisjoint(named):
                raise BadGate("barrier is given the same qubit twice; give it different ones")
            qubits |= named
        return Barrier(tuple(qubits))

    def _if(self) -> If:
        """Read a condition and what depends on it; a value that no register has never holds."""
        self._tokens.take()
        self._tokens.expect("(")
        name = self._tokens.name()
        value = self._tokens.integer() if self._tokens.accept("==") else None
        if value is None:
            self._fail("compare a classical register with a number: if(c==1)")
        self._tokens.expect(")")
        register = self._classical.get(name.text)
        if register is None:
            self._fail(f"no classical register {name.text!r}; {self._known()}")
        return If(register, value, tuple(map(self._counted, self._operations())))

    def _operands(self) -> list[Operand]:
        operands = [self._operand()]
        while self._tokens.accept(","):
            operands.append(self._operand())
        self._tokens.expect(";")
        return operands

    def _operand(self) -> Operand:
        name, index = self._tokens.name(), None
        if self._tokens.accept("["):
            index = self._tokens.integer()
            if index is None or not self._tokens.accept("]"):
                self._tokens.fail("an index is one number, as in q[0]", name.position)
        return Operand(name.text, index, name.position)

    def _qubits_of(self, operand: Operand) -> Sequence[int]:
        if operand.name not in self._quantum:
            problem = f"no quantum register {operand.name!r}; {self._known()}"
            self._tokens.fail(problem, operand.position)
        return self._indexed(operand, self._quantum[operand.name])

    def _bits_of(self, operand: Operand) -> Sequence[int]:
        register = self._classical.get(operand.name)
        if register is None:
            problem = f"no classical register {operand.name!r}; {self._known()}"
            self._tokens.fail(problem, operand.position)
        return self._indexed(operand, range(register.first, register.first + register.size))

    def _indexed(self, operand: Operand, register: range) -> range:
        if operand.index is None:
            return register
        if operand.index >= len(register):
            name, last = operand.name, len(register) - 1
            problem = f"{name}[{operand.index}] is out of range; {name} ends at [{last}]"
            self._tokens.fail(problem, operand.position)
        return register[operand.index : operand.index + 1]

    def _known(self) -> str:
        names = [f"qreg {name}" for name in self._quantum]
        names += [f"creg {name}" for name in self._classical]
        return f"declared are {', '.join(names)}" if names else "declare it first"

    def _fail(self, problem: str) -> NoReturn:
        self._tokens.fail(problem, self._statement_position)
