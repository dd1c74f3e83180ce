"""From OpenQASM 2.0 (arXiv:1707.03429) to a circuit."""

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from openqasm3 import ast

from dispatcher.sabot.circuits.circuit import (
    MAX_BITS,
    MAX_OPERATIONS,
    MAX_QUBITS,
    Barrier,
    Circuit,
    ClassicalRegister,
    Gate,
    If,
    Measure,
    Operation,
    Reset,
)
from dispatcher.sabot.circuits.expressions import BadExpression, evaluate
from dispatcher.sabot.circuits.gates import BadGate, standard_gates
from dispatcher.sabot.circuits.source import Source
from dispatcher.sabot.circuits.syntax import parse_qasm

Operand = ast.Identifier | ast.IndexedIdentifier
NOT_IN_2 = (
    "OpenQASM 2.0 has no such statement; use qreg, creg, gate, gates, measure, reset, barrier "
    "and if(c==1)"
)


def read_qasm(source: Source) -> Circuit:
    """Return the circuit of a program; raise CircuitError with its line and column."""
    with _growing():
        return _Reader(source).read(parse_qasm(source))


@contextmanager
def _growing() -> Iterator[None]:
    """Look for no garbage meanwhile: a tree that only grows has none, and to look takes as long."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


class _Reader:
    """Reads one program from its first statement to its last."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._gates = standard_gates()
        self._quantum: dict[str, range] = {}
        self._classical: dict[str, ClassicalRegister] = {}
        self._qubits = self._bits = self._count = 0

    def read(self, program: ast.Program) -> Circuit:
        """Return the circuit."""
        operations: list[Operation] = []
        for statement in program.statements:
            try:
                operations += self._statement(statement)
            except (BadGate, BadExpression) as error:
                self._fail(statement, str(error))
            except RecursionError:
                self._fail(statement, "nested too deeply; write it in steps")
        if not self._qubits:
            self._source.fail(1, 1, "the program has no qubits; declare some, as with qreg q[2];")
        return Circuit(self._qubits, tuple(self._classical.values()), tuple(operations))

    def _statement(self, statement: ast.Statement | ast.Pragma) -> Iterator[Operation]:
        match statement:
            case ast.Include():
                if statement.filename != "qelib1.inc":
                    self._fail(statement, 'only "qelib1.inc" can be included; paste other gates')
            case ast.QubitDeclaration():
                self._declare_qubits(statement)
            case ast.ClassicalDeclaration(type=ast.BitType(), init_expression=None):
                self._declare_bits(statement)
            case ast.QuantumGateDefinition():
                self._gates.define(statement)
            case _:
                yield from self._operation(statement)

    def _operation(self, statement: ast.Statement | ast.Pragma) -> Iterator[Operation]:
        for operation in self._written_out(statement):
            self._count += 1
            if self._count > MAX_OPERATIONS:
                self._fail(
                    statement,
                    f"more than {MAX_OPERATIONS:,} operations, with gates and registers written "
                    "out; shorten the program",
                )
            yield operation

    def _written_out(self, statement: ast.Statement | ast.Pragma) -> Iterator[Operation]:
        match statement:
            case ast.QuantumGate(modifiers=[], duration=None):
                yield from self._apply(statement)
            case ast.QuantumMeasurementStatement(measure=measure, target=target):
                if target is None:
                    self._fail(statement, "name the bits to measure into: measure q -> c;")
                yield from self._measure(measure.qubit, target)
            case ast.QuantumReset(qubits=operand):
                yield from (Reset(qubit) for qubit in self._qubits_of(operand))
            case ast.QuantumBarrier(qubits=operands):
                yield self._barrier(operands)
            case ast.BranchingStatement(else_block=[]):
                yield self._if(statement)
            case _:
                self._fail(statement, NOT_IN_2)

    def _declare_qubits(self, statement: ast.QubitDeclaration) -> None:
        name, free = statement.qubit.name, MAX_QUBITS - self._qubits
        size = self._size(statement, name, statement.size, free, "qubits", MAX_QUBITS)
        self._quantum[name] = range(self._qubits, self._qubits + size)
        self._qubits += size

    def _declare_bits(self, statement: ast.ClassicalDeclaration) -> None:
        assert isinstance(statement.type, ast.BitType)
        name, free = statement.identifier.name, MAX_BITS - self._bits
        size = self._size(statement, name, statement.type.size, free, "bits", MAX_BITS)
        self._classical[name] = ClassicalRegister(name, self._bits, size)
        self._bits += size

    def _size(
        self,
        statement: ast.Statement,
        name: str,
        size: ast.Expression | None,
        free: int,
        what: str,
        most: int,
    ) -> int:
        if name in self._quantum or name in self._classical:
            self._fail(statement, f"register {name!r} exists already; take another name")
        if not isinstance(size, ast.IntegerLiteral) or size.value < 1:
            self._fail(statement, f"register {name!r} needs a size of at least 1, as in {name}[2]")
        if size.value > free:
            self._fail(
                statement, f"{size.value} more {what} exceed the limit of {most:,}; use fewer"
            )
        return size.value

    def _apply(self, statement: ast.QuantumGate) -> Iterator[Gate]:
        angles = [evaluate(argument, {}) for argument in statement.arguments]
        name = statement.name.name
        operands = [self._qubits_of(operand) for operand in statement.qubits]
        whole = [
            len(qubits)
            for qubits, operand in zip(operands, statement.qubits, strict=True)
            if isinstance(operand, ast.Identifier)
        ]
        if len(set(whole)) > 1:
            sizes = ", ".join(map(str, whole))
            self._fail(statement, f"registers of {sizes} qubits do not pair up; name qubits")
        for each in range(whole[0] if whole else 1):
            qubits = tuple(own[each] if len(own) > 1 else own[0] for own in operands)
            yield from self._gates.apply(name, angles, qubits)

    def _measure(self, operand: Operand, target: Operand) -> Iterator[Measure]:
        qubits, bits = self._qubits_of(operand), self._bits_of(target)
        if len(qubits) != len(bits):
            problem = f"{len(qubits)} qubits do not fit {len(bits)} bits; measure as many as fit"
            self._fail(operand, problem)
        yield from (Measure(*pair) for pair in zip(qubits, bits, strict=True))

    def _barrier(self, operands: Sequence[ast.Expression | Operand]) -> Barrier:
        qubits: list[int] = []
        for operand in operands:
            assert isinstance(operand, Operand)
            qubits += self._qubits_of(operand)
        return Barrier(tuple(qubits))

    def _if(self, statement: ast.BranchingStatement) -> If:
        match statement.condition:
            case ast.BinaryExpression(
                op=op, lhs=ast.Identifier(name=name), rhs=ast.IntegerLiteral(value=value)
            ) if op.name == "==":
                register = self._classical.get(name)
            case _:
                self._fail(statement, "compare a classical register with a number: if(c==1)")
        if register is None:
            self._fail(statement, f"no classical register {name!r}; {self._known()}")
        if value >> register.size:
            self._fail(statement, f"{name} has {register.size} bits and is never {value}")
        steps = [step for inner in statement.if_block for step in self._operation(inner)]
        return If(register, value, tuple(steps))

    def _qubits_of(self, operand: Operand) -> Sequence[int]:
        name = _name(operand)
        if name not in self._quantum:
            self._fail(operand, f"no quantum register {name!r}; {self._known()}")
        return self._indexed(operand, self._quantum[name])

    def _bits_of(self, operand: Operand) -> Sequence[int]:
        register = self._classical.get(_name(operand))
        if register is None:
            self._fail(operand, f"no classical register {_name(operand)!r}; {self._known()}")
        return self._indexed(operand, range(register.first, register.first + register.size))

    def _indexed(self, operand: Operand, register: range) -> range:
        if isinstance(operand, ast.Identifier):
            return register
        index = _index(operand)
        if index is None:
            self._fail(operand, "an index is one number, as in q[0]")
        if index >= len(register):
            name, last = _name(operand), len(register) - 1
            self._fail(operand, f"{name}[{index}] is out of range; {name} ends at [{last}]")
        return register[index : index + 1]

    def _known(self) -> str:
        names = [f"qreg {name}" for name in self._quantum]
        names += [f"creg {name}" for name in self._classical]
        return f"declared are {', '.join(names)}" if names else "declare it first"

    def _fail(self, node: ast.QASMNode, problem: str) -> NoReturn:
        assert node.span is not None
        self._source.fail(node.span.start_line, node.span.start_column + 1, problem)


def _name(operand: Operand) -> str:
    return operand.name.name if isinstance(operand, ast.IndexedIdentifier) else operand.name


def _index(operand: ast.IndexedIdentifier) -> int | None:
    match operand.indices:
        case [[ast.IntegerLiteral(value=index)]]:
            return index
    return None
