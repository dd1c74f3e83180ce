"""The gates that a QASM program may use: built in, of qelib1.inc, or defined by itself."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from applications.circuits.circuit import MAX_OPERATIONS, Gate, Source
from applications.circuits.expressions import Expression, evaluate, read_arguments
from applications.circuits.syntax import KEYWORDS, Tokens
from dispatcher.sabot.gates import ROTATIONS, as_clifford

STANDARD_LIBRARY = Path(__file__).with_name("qelib1.inc")
MAX_DEPTH = 64  # of definitions that use definitions
MOST_NAMES = 60  # in an error message
TOLERANCE_RAD = 1e-9  # as near to a multiple of pi/2 is taken for it: programs round their angles

# Name in QASM: our name, qubits, parameters.
BUILT_IN: dict[str, tuple[str, int, int]] = {
    **{name: (name.upper(), 1, 0) for name in ("x", "y", "z", "h", "s", "t")},
    "id": ("I", 1, 0),
    "sdg": ("S_DAG", 1, 0),
    "tdg": ("T_DAG", 1, 0),
    "cx": ("CX", 2, 0),
    "cz": ("CZ", 2, 0),
    **{name: (name.upper(), 1, 1) for name in ("rx", "ry", "rz")},
}


class BadGate(ValueError):
    """A gate that cannot be applied so; the message says why."""


@dataclass(frozen=True)
class Primitive:
    name: str
    qubits: int
    parameters: int


@dataclass(frozen=True)
class Step:
    """One gate in a definition, which qubits of it the gate is given, and with what angles."""

    gate: "Primitive | Definition"
    qubits: tuple[int, ...]
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Definition:
    """A gate made of gates that were known when it was defined."""

    name: str
    qubits: int
    parameter_names: tuple[str, ...]
    body: tuple[Step, ...]
    cost: int  # how many gates it is when written out, or a little more
    depth: int  # of definitions that use definitions

    @property
    def parameters(self) -> int:
        return len(self.parameter_names)


class Gates:
    """Gates by name; one that is defined later hides an earlier one."""

    def __init__(self, gates: Mapping[str, Primitive | Definition]) -> None:
        self.known = dict(gates)

    def define(self, tokens: Tokens) -> None:
        """Read what follows the word gate, and add that gate.

        Raise BadGate if its body uses an unknown gate or qubit.
        """
        name, parameters, qubits = _read_heading(tokens)
        body = tuple(self._read_body(tokens, parameters, qubits))
        used = [step.gate for step in body if isinstance(step.gate, Definition)]
        depth = 1 + max((gate.depth for gate in used), default=0)
        cost = 1 + len(body) + sum(gate.cost for gate in used)
        if depth > MAX_DEPTH or cost > MAX_OPERATIONS:
            raise BadGate(
                f"the gate is {cost:,} gates, defined {depth} deep; at most {MAX_OPERATIONS:,} "
                f"and {MAX_DEPTH} are allowed"
            )
        self.known[name] = Definition(name, len(qubits), tuple(parameters), body, cost, depth)

    def declare(self, tokens: Tokens) -> None:
        """Read what follows the word opaque: a gate that the simulator defines, if any does."""
        name, parameters, qubits = _read_heading(tokens)
        tokens.expect(";")
        if name in self.known:
            self._require(name, len(parameters), len(qubits))

    def apply(self, name: str, angles: Sequence[float], qubits: tuple[int, ...]) -> Iterator[Gate]:
        """Yield what a gate does to qubits, in gates that the interpreter knows.

        Raise BadGate for an unknown gate or a wrong number of anything.
        """
        gate = self._require(name, len(angles), len(qubits))
        _require_different(name, qubits)
        yield from _written_out(gate, angles, qubits)

    def _require(self, name: str, parameters: int, qubits: int) -> Primitive | Definition:
        gate = self.known.get(name)
        if gate is None:
            names = ", ".join(sorted(self.known)[:MOST_NAMES])
            raise BadGate(f"unknown gate {name!r}; define it, or use one of {names}")
        for what, count, fitting in (
            ("qubit", qubits, gate.qubits),
            ("parameter", parameters, gate.parameters),
        ):
            if count != fitting:
                plural = "" if fitting == 1 else "s"
                raise BadGate(f"{name} takes {fitting} {what}{plural}, not {count}")
        return gate

    def _read_body(
        self, tokens: Tokens, parameters: Sequence[str], qubits: Sequence[str]
    ) -> Iterator[Step]:
        tokens.expect("{")
        while not tokens.accept("}"):
            if tokens.next.text in KEYWORDS and tokens.next.text != "barrier":
                tokens.fail(f"{tokens.next.text!r} cannot be in a gate, which is made of gates")
            name = tokens.name().text
            arguments = read_arguments(tokens, parameters)
            operands = _read_names(tokens)
            if tokens.next.text == "[":
                raise BadGate(f"{operands[-1]} has an index; in a gate each qubit has its own name")
            tokens.expect(";")
            for operand in operands:
                if operand not in qubits:
                    names = ", ".join(qubits)
                    raise BadGate(f"{operand!r} is not a qubit of the gate; it has {names}")
            if name != "barrier":
                gate = self._require(name, len(arguments), len(operands))
                _require_different(name, operands)
                yield Step(gate, tuple(map(qubits.index, operands)), arguments)


def _read_heading(tokens: Tokens) -> tuple[str, list[str], list[str]]:
    name = tokens.new_name()
    parameters: list[str] = []
    if tokens.accept("(") and not tokens.accept(")"):
        parameters = _read_names(tokens)
        tokens.expect(")")
    qubits = _read_names(tokens)
    for each, number in Counter([*parameters, *qubits]).items():
        if number > 1:
            raise BadGate(f"{each!r} is named twice; name each parameter and qubit once")
    return name, parameters, qubits


def _read_names(tokens: Tokens) -> list[str]:
    names = [tokens.new_name()]
    while tokens.accept(","):
        names.append(tokens.new_name())
    return names


def _written_out(
    gate: Primitive | Definition, angles: Sequence[float], qubits: tuple[int, ...]
) -> Iterator[Gate]:
    if isinstance(gate, Primitive):
        # A rotation by 4 pi is none at all.
        angle_rad = math.remainder(angles[0], 4 * math.pi) if angles else 0.0
        yield from lowered(Gate(gate.name, qubits, angle_rad))
        return
    parameters = dict(zip(gate.parameter_names, angles, strict=True))
    for step in gate.body:
        values = [evaluate(argument, parameters) for argument in step.arguments]
        yield from _written_out(step.gate, values, tuple(qubits[which] for which in step.qubits))


def _require_different(name: str, qubits: Sequence[int | str]) -> None:
    if len(set(qubits)) < len(qubits):
        raise BadGate(f"{name} is given the same qubit twice; give it different ones")


@cache
def _standard() -> Mapping[str, Primitive | Definition]:
    gates = Gates({name: Primitive(*gate) for name, gate in BUILT_IN.items()})
    tokens = Tokens(Source(STANDARD_LIBRARY.name, STANDARD_LIBRARY.read_text()))
    while tokens.accept("gate"):
        gates.define(tokens)
    assert tokens.next.kind == "end"
    return gates.known


def standard_gates() -> Gates:
    return Gates(_standard())


def lowered(gate: Gate) -> Iterator[Gate]:
    """Yield Clifford gates for a rotation by a multiple of pi/2, any other gate as it is.

    Global phases do not matter.
    """
    for rotation in ROTATIONS:
        quarters = round(gate.angle_rad / (math.pi / 2))
        if gate.name == rotation and abs(gate.angle_rad - quarters * math.pi / 2) < TOLERANCE_RAD:
            names = as_clifford(rotation, quarters * math.pi / 2)
            yield from (Gate(name, gate.qubits) for name in names or ("I",))
            return
    yield gate
