"""OpenQASM 2.0 as users write it, and the errors of wrong programs."""

import math
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from applications.circuits.circuit import (
    MAX_OPERATIONS,
    Barrier,
    Circuit,
    CircuitError,
    ClassicalRegister,
    Gate,
    If,
    Measure,
    Reset,
    Source,
    read_source,
)
from applications.circuits.gates import standard_gates
from applications.circuits.qasm import read_qasm
from dispatcher.recording.writer import MAX_QUBITS, MAX_SOURCE_BYTES

Matrix = NDArray[Any]

HEADER = 'OPENQASM 2.0;\ninclude "qelib1.inc";\n'
REGISTERS = HEADER + "qreg q[2]; qreg r[2];\ncreg c[2];\n"  # the next line is line 5


def read(text: str) -> Circuit:
    """Read a program."""
    return read_qasm(Source("program.qasm", text))


def operations(body: str) -> tuple[object, ...]:
    """Return what a program with two registers of two qubits does."""
    return read(REGISTERS + body).operations


def test_a_program_becomes_a_circuit() -> None:
    c, d = ClassicalRegister("c", 0, 2), ClassicalRegister("d", 2, 1)
    text = """// a comment
    OPENQASM 2.0; include "qelib1.inc";
    qreg q[2]; creg c[2]; creg d[1];
    h q[0]; cx q[0], q[1]; sdg q[1];
    barrier q;
    measure q[0] -> c[1];
    if (c==2) reset q[1];
    """
    assert read(text) == Circuit(
        2,
        (c, d),
        (
            Gate("H", (0,)),
            Gate("CX", (0, 1)),
            Gate("S_DAG", (1,)),
            Barrier((0, 1)),
            Measure(0, 1),
            If(c, 2, (Reset(1),)),
        ),
    )


def test_registers_are_written_out() -> None:
    assert operations("h q; cx q, r; cx q[0], r; measure r -> c;") == (
        *(Gate("H", (qubit,)) for qubit in (0, 1)),
        *(Gate("CX", pair) for pair in ((0, 2), (1, 3), (0, 2), (0, 3))),
        *(Measure(2 + bit, bit) for bit in (0, 1)),
    )


def test_a_condition_is_asked_once_for_a_whole_register() -> None:
    (conditional,) = operations("if(c==1) measure q -> c;")
    assert isinstance(conditional, If)
    assert conditional.operations == (Measure(0, 0), Measure(1, 1))


def test_a_value_that_no_register_has_is_a_condition_that_never_holds() -> None:
    (conditional,) = operations("if(c==4) x q[0];")
    assert conditional == If(ClassicalRegister("c", 0, 2), 4, (Gate("X", (0,)),))


@pytest.mark.parametrize("name", ["in", "out", "bit", "ctrl", "qubit", "for", "int", "delay", "π2"])
def test_words_of_openqasm_3_are_names(name: str) -> None:
    body = f"qreg {name}[1]; gate {name}x({name}) a {{ rx({name}) a; }} {name}x(1) {name}[0];"
    assert operations(body) == (Gate("RX", (4,), 1.0),)


def test_an_opaque_gate_is_the_one_that_the_simulator_defines() -> None:
    assert operations("opaque delay(t) a; delay(300.0) q[0];") == (Gate("I", (0,)),)


def test_a_statement_may_be_as_long_as_a_program() -> None:
    names = "".join(f"q[{qubit}]," for qubit in range(MAX_QUBITS))
    text = f"{HEADER}qreg q[{MAX_QUBITS}]; gate g a {{ {'h a; ' * 9000} }} barrier {names[:-1]};"
    assert read(text).operations == (Barrier(tuple(range(MAX_QUBITS))),)


def test_gates_can_be_defined_by_gates() -> None:
    body = "gate a(x) p, s { rz(-x/2) p; cx s, p; } gate b p, s { a(pi) s, p; barrier p; }"
    assert operations(f"{body} b q[0], q[1];") == (Gate("S_DAG", (1,)), Gate("CX", (0, 1)))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.25", 0.25),
        ("-pi/3 + 2*(1 - 0.5)", 1 - math.pi / 3),
        ("sqrt(2)^3", 2**1.5),
        ("pi/2^2", math.pi / 4),
        ("-2^2", -4),
        ("2^3^2/100", 5.12),
        ("2*2^-1*-1", -1),
        ("8/2/2 - 1 - .5", 0.5),
        ("+(.5e1 + 1.)", 6),
        ("sin(1)*cos(1)/tan(1)", math.cos(1) ** 2),
        ("ln(exp(0.3))", 0.3),
    ],
)
def test_angles_are_computed(text: str, value: float) -> None:
    (gate,) = operations(f"rx({text}) q[0];")
    assert isinstance(gate, Gate)
    assert gate.angle_rad == pytest.approx(value)


@pytest.mark.parametrize("brackets", ["rx({}) q[0];", "gate g(x) a {{ rx(x) a; }} g({}) q[0];"])
def test_a_bracket_may_hold_250_characters_and_no_more(brackets: str) -> None:
    (gate,) = operations(brackets.format("0.5" + " " * 247))
    assert isinstance(gate, Gate)
    assert gate.angle_rad == 0.5
    with pytest.raises(CircuitError, match="a bracket holds more than 250 characters"):
        operations(brackets.format("0.5" + " " * 248))


H = np.array([[1, 1], [1, -1]]) / math.sqrt(2)
MATRICES = {
    "I": np.eye(2),
    "X": np.array([[0, 1], [1, 0]]),
    "Y": np.array([[0, -1j], [1j, 0]]),
    "Z": np.diag([1, -1]),
    "H": H,
    "S": np.diag([1, 1j]),
    "S_DAG": np.diag([1, -1j]),
    "T": np.diag([1, np.exp(0.25j * math.pi)]),
    "T_DAG": np.diag([1, np.exp(-0.25j * math.pi)]),
}


def rotation(axis: str, angle: float) -> Matrix:
    """Return exp(-i angle/2 P)."""
    pauli = MATRICES[axis]
    return np.asarray(math.cos(angle / 2) * np.eye(2) - 1j * math.sin(angle / 2) * pauli)


def unitary(body: str, qubits: int) -> Matrix:
    """Multiply the gates of a program out; qubit 0 is the most significant."""
    whole: Matrix = np.eye(2**qubits)
    for gate in read(f"{HEADER}qreg q[{qubits}];{body}").operations:
        assert isinstance(gate, Gate)
        factors = [np.eye(2, dtype=np.complex128)] * qubits
        if gate.name in ("CX", "CZ"):
            control, target = gate.qubits
            low, high = list(factors), list(factors)
            low[control], high[control] = np.diag([1, 0]), np.diag([0, 1])
            high[target] = MATRICES[gate.name[1]].astype(np.complex128)
            matrix = product(low) + product(high)
        else:
            name = gate.name
            one = rotation(name[1], gate.angle_rad) if name[0] == "R" else MATRICES[name]
            factors[gate.qubits[0]] = one.astype(np.complex128)
            matrix = product(factors)
        whole = matrix @ whole
    return whole


def product(
    factors: list[Matrix],
) -> Matrix:
    """Return the tensor product."""
    whole: Matrix = np.eye(1)
    for factor in factors:
        whole = np.kron(whole, factor)
    return whole


def controlled(
    inner: Matrix,
) -> Matrix:
    """Return what applies a unitary if a first qubit is 1."""
    size = len(inner)
    return np.block([[np.eye(size), np.zeros((size, size))], [np.zeros((size, size)), inner]])


A, B, C = 0.7, -1.1, 2.3
SWAP = np.eye(4)[[0, 2, 1, 3]]
PHASE = np.diag([1, np.exp(1j * A)])
U = rotation("Z", B) @ rotation("Y", A) @ rotation("Z", C)
# U3(A, B, C) as OpenQASM and Qiskit write it: its first element is real.
U3 = np.exp(0.5j * (B + C)) * U
SX = np.array([[1 + 1j, 1 - 1j], [1 - 1j, 1 + 1j]]) / 2  # the root of X whose eigenvalues are 1, i
# Qubits are the most significant first. Maslov, Phys. Rev. A 93, 022311: figures 3 and 4.
RCCX = controlled(np.block([[MATRICES["Z"], np.zeros((2, 2))], [np.zeros((2, 2)), MATRICES["Y"]]]))
RC3X = np.eye(16, dtype=np.complex128)
RC3X[12:14, 12:14] = np.diag([1j, -1j])  # a and b are 1, c is 0
RC3X[14:, 14:] = [[0, 1], [-1, 0]]  # all three are 1


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("u3(0.7,-1.1,2.3) q[0];", U),
        ("U(0.7,-1.1,2.3) q[0];", U),
        ("u2(-1.1,2.3) q[0];", rotation("Z", B) @ rotation("Y", math.pi / 2) @ rotation("Z", C)),
        ("u1(0.7) q[0];", PHASE),
        ("p(0.7) q[0];", PHASE),
        ("sx q[0]; sx q[0];", MATRICES["X"]),
        ("sx q[0]; sxdg q[0];", np.eye(2)),
        ("u0(1) q[0];", np.eye(2)),
        ("cx q[0],q[1];", controlled(MATRICES["X"])),
        ("CX q[0],q[1];", controlled(MATRICES["X"])),
        ("cz q[0],q[1];", controlled(MATRICES["Z"])),
        ("cy q[0],q[1];", controlled(MATRICES["Y"])),
        ("ch q[0],q[1];", controlled(H)),
        ("swap q[0],q[1];", SWAP),
        ("crz(0.7) q[0],q[1];", controlled(rotation("Z", A))),
        ("crx(0.7) q[0],q[1];", controlled(rotation("X", A))),
        ("cry(0.7) q[0],q[1];", controlled(rotation("Y", A))),
        ("cu1(0.7) q[0],q[1];", controlled(PHASE)),
        ("cp(0.7) q[0],q[1];", controlled(PHASE)),
        ("cu3(0.7,-1.1,2.3) q[0],q[1];", controlled(U3)),
        ("cu(0.7,-1.1,2.3,0.4) q[0],q[1];", controlled(np.exp(0.4j) * U3)),
        ("csx q[0],q[1];", controlled(SX)),
        ("rccx q[0],q[1],q[2];", RCCX),
        ("rc3x q[0],q[1],q[2],q[3];", RC3X),
        ("c3x q[0],q[1],q[2],q[3];", controlled(controlled(controlled(MATRICES["X"])))),
        ("c3sqrtx q[0],q[1],q[2],q[3];", controlled(controlled(controlled(SX)))),
        (
            "c4x q[0],q[1],q[2],q[3],q[4];",
            controlled(controlled(controlled(controlled(MATRICES["X"])))),
        ),
        ("delay(300) q[0];", np.eye(2)),
        ("rzz(0.7) q[0],q[1];", np.diag(np.exp(0.5j * A * np.array([-1, 1, 1, -1])))),
        (
            "h q; rxx(0.7) q[0],q[1]; h q;",
            np.diag(np.exp(0.5j * A * np.array([-1, 1, 1, -1]))),
        ),
        ("ccx q[0],q[1],q[2];", controlled(controlled(MATRICES["X"]))),
        ("cswap q[0],q[1],q[2];", controlled(SWAP)),
        *(
            (f"{name}({turns}*pi/2) q[0];", rotation(name[1].upper(), turns * math.pi / 2))
            for name in ("rx", "ry", "rz")
            for turns in range(-3, 5)
        ),
    ],
)
def test_gates_are_those_of_the_field(body: str, expected: Matrix) -> None:
    found = unitary(body, int(math.log2(len(expected))))
    overlap = np.trace(expected.conj().T @ found) / len(expected)
    assert abs(overlap) == pytest.approx(1)


def test_every_gate_is_tested_above() -> None:
    tested = str([mark.args for mark in test_gates_are_those_of_the_field.pytestmark])  # type: ignore[attr-defined]
    alone = {"id", "x", "y", "z", "h", "s", "sdg", "t", "tdg", "u"}
    for name in standard_gates().known.keys() - alone:
        assert f"{name}(" in tested or f"{name} " in tested, name


def test_quarter_turns_are_clifford_gates() -> None:
    names = {"I", "X", "Y", "Z", "H", "S", "S_DAG", "CX", "CZ"}
    body = "u3(pi/2,-pi,pi/2) q[0]; rx(-pi) q; ry(3*pi/2) q; cu1(pi) q[0],q[1]; u2(0,pi) q;"
    assert {gate.name for gate in operations(body) if isinstance(gate, Gate)} <= names


WRONG = [
    ("foo q[0];", "5:1", "unknown gate 'foo'"),
    ("h q[0];\n  cx q[0];", "6:3", "cx takes 2 qubits, not 1"),
    ("rx q[0];", "5:1", "rx takes 1 parameter, not 0"),
    ("h q[0], q[1];", "5:1", "h takes 1 qubit, not 2"),
    ("h q[2];", "5:3", "q[2] is out of range; q ends at [1]"),
    ("h q[-1];", "5:3", "an index is one number"),
    ("h q[0:1];", "5:3", "an index is one number"),
    ("h x[0];", "5:3", "no quantum register 'x'; declared are qreg q, qreg r, creg c"),
    ("cx q[0], q[0];", "5:1", "same qubit twice"),
    ("cx q, q;", "5:1", "same qubit twice"),
    ("measure q -> c[0];", "5:9", "2 qubits do not fit 1 bits"),
    ("measure q[0] -> d[0];", "5:17", "no classical register 'd'"),
    ("measure q[0];", "5:1", "name the bits"),
    ("measure q[0] -> c[2];", "5:17", "c[2] is out of range"),
    ("if(d==1) x q[0];", "5:1", "no classical register 'd'"),
    ("if(c>1) x q[0];", "5:1", "compare a classical register with a number"),
    ("if(c==1) {x q[0];} else {y q[0];}", "5:10", "OpenQASM 2.0 has no such statement"),
    ("if(c==1) foo q[0];", "5:1", "unknown gate"),
    ("qreg q[1];", "5:1", "register 'q' exists already"),
    ("creg r[1];", "5:1", "register 'r' exists already"),
    ("qreg s[0];", "5:1", "register 's' needs a size of at least 1"),
    ("qreg measure[1];", "5:6", "'measure' is a word of OpenQASM 2.0; take another name"),
    ("gate pi a { h a; }", "5:6", "'pi' is a word of OpenQASM 2.0"),
    ("opaque magic(x) a; magic(1) q[0];", "5:20", "unknown gate 'magic'; define it"),
    ("opaque cx a;", "5:1", "cx takes 2 qubits, not 1"),
    ("if(c==1) if(c==1) x q;", "5:10", "OpenQASM 2.0 has no such statement"),
    ("barrier q[0], q;", "5:1", "same qubit twice"),
    ("rx(2**3) q[0];", "5:6", "'*' is not expected here"),
    (f"qreg s[{MAX_QUBITS - 3}];", "5:1", "the limit of 1,000"),
    ("creg d[5000];", "5:1", "the limit of 4,096"),
    ("qreg three[3]; cx q, three;", "5:16", "registers of 2, 3 qubits do not pair up"),
    ("gate g a { h b; }", "5:1", "'b' is not a qubit of the gate; it has a"),
    ("gate g a { g a; }", "5:1", "unknown gate 'g'"),
    ("gate g a, a { h a; }", "5:1", "'a' is named twice"),
    ("gate g a { h a[0]; }", "5:1", "a has an index"),
    ("gate g a, b { cx a, a; }", "5:1", "same qubit twice"),
    ("gate g a { reset a; }", "5:12", "reset"),
    ("gate g(x) a { rx(y) a; } g(1) q[0];", "5:18", "unknown parameter 'y'; known are pi, x"),
    ("rx(1/0) q[0];", "5:1", "division by zero"),
    ("rx(10^400) q[0];", "5:1", "cannot be computed"),
    ("rx(1e308*10) q[0];", "5:1", "the angle is inf"),
    ("rx(sqrt(-1)) q[0];", "5:1", "cannot be computed"),
    ("rx(foo(1)) q[0];", "5:4", "unknown function 'foo'; use one of sin, cos"),
    ("int i = 2;", "5:7", "'=' is not expected here"),
    ("ctrl @ x q[0], q[1];", "5:6", "'@' is not expected here"),
    ("{ x q[0]; }", "5:1", "OpenQASM 2.0 has no such statement"),
    ('include "stdgates.inc";', "5:1", 'only "qelib1.inc"'),
    ("h q[0]\nx q[1];", "6:1", "'x' is not expected here; is a ';'"),
    ("h q[0]", "5:7", "the end of the program is not expected here"),
    ("h % q;", "5:3", "'%' is not expected here"),
    ("h q[0]; \\", "5:9", "OpenQASM 2.0 has no such statement"),
    ("x q;\n rx(" + "(" * 31 + "1" + ")" * 31 + ") q[0];", "6:34", "more than 30 deep"),
    ("x q;\n rx(" + "-" * 600 + "1) q[0];", "6:4", "more than 250 characters"),
    ("rx(" + "2^" * 40 + "1) q[0];", "5:63", "more than 30 deep"),
    ("rx(1) q[" + "1" * 5000 + "];", "5:9", "thousands of digits"),
    ("if(c==1) {" * 2000 + "}" * 2000, "5:10", "OpenQASM 2.0 has no such statement"),
]


@pytest.mark.parametrize(("body", "place", "problem"), WRONG)
def test_an_error_names_line_and_column_and_says_what_to_do(
    body: str, place: str, problem: str
) -> None:
    with pytest.raises(CircuitError) as raised:
        read(REGISTERS + body)
    assert str(raised.value).startswith(f"program.qasm:{place}: ")
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "not OpenQASM"),
        ("hello", "begin with the lines OPENQASM 2.0;"),
        ("OPENQASM 3.0; qubit q;", "this is OpenQASM 3.0"),
        ("OPENQASM 2.0;", "no qubits"),
        ("comment\n#\nh 0\n", "--format chp"),
    ],
)
def test_what_is_not_qasm_is_said_to_be_so(text: str, problem: str) -> None:
    with pytest.raises(CircuitError, match=problem):
        read(text)


def test_definitions_that_grow_without_end_are_refused_before_they_are_written_out() -> None:
    steps = "gate g0 a { id a; }"
    steps += "".join(f"gate g{n} a {{ g{n - 1} a; g{n - 1} a; }}\n" for n in range(1, 60))
    with pytest.raises(CircuitError, match=f"at most {MAX_OPERATIONS:,}"):
        operations(steps + "g59 q[0];")
    chain = "gate g0 a { id a; }"
    chain += "".join(f"gate g{n} a {{ g{n - 1} a; }}\n" for n in range(1, 80))
    with pytest.raises(CircuitError, match="64 are allowed"):
        operations(chain)


def test_spoiled_programs_are_refused_or_read() -> None:
    random, letters = Random(1), 'qc[]();,->=+*/^0123456789. hxzif{}@$#"\\\0é'
    program = REGISTERS + "gate g(a) p, s { rz(a) p; cx p, s; } g(pi/2) q[0], r[1]; if(c==1) x q;"
    for _ in range(300):
        spoiled = list(program)
        for _ in range(random.randint(1, 4)):
            place = random.randrange(len(spoiled))
            spoiled[place : place + random.randint(0, 2)] = random.choice(letters)
        with suppress(CircuitError):
            assert read("".join(spoiled)).qubits


def test_too_many_operations_are_refused() -> None:
    gate = "gate g a {" + "h a;" * 2000 + "}"
    with pytest.raises(CircuitError, match=r"7:1: more than 200,000 operations"):
        operations(f"{gate}\nqreg s[99]; g s;\n" + "g q;")


def test_a_file_that_is_too_long_or_no_text_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "program.qasm"
    file.write_bytes(b" " * (MAX_SOURCE_BYTES + 1))
    with pytest.raises(CircuitError, match=r"program.qasm is longer than 1,048,576 bytes"):
        read_source(str(file))
    file.write_bytes(b"OPENQASM \xff")
    with pytest.raises(CircuitError, match="byte 9 is 0xff"):
        read_source(str(file))
    file.write_bytes(b"\xef\xbb\xbfOPENQASM 2.0; qreg q[1];")
    assert read_qasm(read_source(str(file))).qubits == 1
    with pytest.raises(CircuitError, match="No such file"):
        read_source(str(tmp_path / "absent.qasm"))
    with pytest.raises(CircuitError, match="Is a directory"):
        read_source(str(tmp_path))
