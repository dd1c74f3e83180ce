"""Circuits on backends: shots as members, conditions, and stim as oracle."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import stim
from numpy.random import Generator

from applications.circuits.circuit import (
    MAX_SHOTS,
    Circuit,
    CircuitError,
    ClassicalRegister,
    Gate,
    If,
    Measure,
    Operation,
    Source,
    read_source,
)
from applications.circuits.interpreter import PAULIS, measurements_at_end, run_circuit
from applications.circuits.qasm import read_qasm
from applications.circuits.reading import count
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.backends import BACKENDS

QISKIT_FOLDER = Path(__file__).with_name("qiskit_circuits")
QISKIT = json.loads((QISKIT_FOLDER / "probabilities.json").read_text())
QUBITS, BITS = 5, 10
REGISTERS = tuple(ClassicalRegister(f"c{bit}", bit, 2) for bit in range(0, BITS, 2))


def counts(body: str, shots: int = 1000, backend: str = "chp", seed: int = 1) -> dict[str, int]:
    """Run a program; return how often each value came."""
    circuit = read_qasm(Source("program", 'OPENQASM 2.0;include "qelib1.inc";' + body))
    return dict(count(circuit, run_circuit(circuit, BACKENDS[backend], shots, seed)))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_ghz_state_gives_equal_bits(backend: str) -> None:
    body = "qreg q[3]; creg c[3]; h q[0]; cx q[0],q[1]; cx q[1],q[2]; measure q -> c;"
    found = counts(body, 10_000, backend)
    assert found.keys() == {"000", "111"}
    assert abs(found["000"] - 5000) < 5 * 50


@pytest.mark.parametrize("backend", BACKENDS)
def test_teleportation_with_feed_forward_is_exact(backend: str) -> None:
    body = (
        "qreg q[3]; creg a[1]; creg b[1]; creg out[1]; u2(pi/2,pi) q[0]; h q[1]; cx q[1],q[2];"
        "cx q[0],q[1]; h q[0]; measure q[0] -> a[0]; measure q[1] -> b[0];"
        "if(a==1) z q[2]; if(b==1) x q[2]; sdg q[2]; h q[2]; measure q[2] -> out[0];"
    )
    found = counts(body, 4000, backend)
    assert found.keys() == {"0 0 0", "0 1 0", "1 0 0", "1 1 0"}
    assert all(abs(number - 1000) < 5 * 750**0.5 for number in found.values())


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_condition_on_a_gate_that_is_no_pauli_divides_the_shots(backend: str) -> None:
    body = (
        "qreg q[2]; creg c[1]; creg d[2]; h q[0]; measure q[0] -> c[0];"
        "if(c==1) h q[1]; if(c==1) h q[1]; if(c==0) x q[1]; measure q -> d;"
    )
    assert counts(body, backend=backend).keys() == {"0 10", "1 01"}


@pytest.mark.parametrize("backend", BACKENDS)
def test_reset_makes_zero_and_leaves_the_partner_mixed(backend: str) -> None:
    body = "qreg q[2]; creg c[2]; h q[0]; cx q[0],q[1]; reset q[0]; measure q -> c;"
    found = counts(body, 10_000, backend)
    assert found.keys() == {"00", "10"}
    assert abs(found["00"] - 5000) < 5 * 50


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_condition_on_a_value_that_a_register_never_has_does_nothing(backend: str) -> None:
    body = "qreg q[1]; creg c[2]; if(c==4) x q[0]; if(c==4) h q[0]; measure q[0] -> c[0];"
    assert counts(body, backend=backend) == {"00": 1000}


@pytest.mark.parametrize("name", sorted(QISKIT["probabilities"]))
def test_circuits_that_qiskit_exports_have_the_distribution_that_it_computes(name: str) -> None:
    circuit = read_qasm(read_source(str(QISKIT_FOLDER / f"{name}.qasm")))
    shots, expected = 100_000, QISKIT["probabilities"][name]
    found = dict(count(circuit, run_circuit(circuit, BACKENDS["dense"], shots, 1)))
    assert found.keys() <= expected.keys()
    for value, p in expected.items():
        assert abs(found.get(value, 0) - shots * p) <= 5 * (shots * p * (1 - p)) ** 0.5 + 1e-6


@pytest.mark.parametrize("seed", range(10))
def test_shots_of_one_state_are_those_of_a_state_each(seed: int) -> None:
    random = np.random.default_rng(seed)

    def gates(first: int) -> list[Gate]:
        pairs = (random.permutation(np.arange(first, QUBITS))[:2].tolist() for _ in range(30))
        turns = random.uniform(0, 7, size=30)
        return [
            gate
            for (one, other), angle in zip(pairs, turns, strict=True)
            for gate in (Gate("RX", (one,), angle), Gate("T", (one,)), Gate("CX", (one, other)))
        ]

    last = random.integers(QUBITS, size=BITS - 1)
    measurements = [Measure(int(qubit), bit) for bit, qubit in enumerate(last, 1)]
    operations: tuple[Operation, ...] = (*gates(0), Measure(0, 0), *gates(1), *measurements)
    circuit = Circuit(QUBITS, REGISTERS, operations)
    never = If(REGISTERS[0], 4, (Gate("X", (0,)),))
    divided = replace(circuit, operations=(*operations, never))
    assert measurements_at_end(circuit) == [Measure(0, 0), *measurements]
    assert measurements_at_end(divided) is None
    one, each = (
        np.hstack(list(run_circuit(made, BACKENDS["dense"], 300, seed)))
        for made in (circuit, divided)
    )
    assert (one == each).all()


def test_a_condition_is_of_the_moment_it_is_reached() -> None:
    body = (
        "qreg q[2]; creg c[2]; x q[0]; measure q[0] -> c[0];"
        "if(c==1) measure q -> c; if(c==1) x q[1]; measure q[1] -> c[1]; if(c==1) x q[0];"
        "measure q[0] -> c[0];"
    )
    assert counts(body) == {"11": 1000}


def test_a_measured_qubit_stays() -> None:
    body = "qreg q[1]; creg c[2]; h q; measure q[0] -> c[0]; measure q[0] -> c[1];"
    assert counts(body).keys() == {"00", "11"}


def test_the_highest_bit_comes_first_and_the_most_frequent_value_too() -> None:
    body = "qreg q[3]; creg c[3]; creg d[1]; x q[1]; h q[2]; h q[0]; cx q[2],q[0]; measure q -> c;"
    circuit = read_qasm(Source("program", 'OPENQASM 2.0;include "qelib1.inc";' + body))
    rows = count(circuit, run_circuit(circuit, BACKENDS["chp"], 1001, 1))
    assert {value for value, _number in rows} == {"010 0", "011 0", "110 0", "111 0"}
    assert [number for _value, number in rows] == sorted(dict(rows).values(), reverse=True)


def test_a_seed_repeats_and_another_differs() -> None:
    body = "qreg q[4]; creg c[4]; h q; measure q -> c;"
    assert counts(body, seed=1) == counts(body, seed=1) != counts(body, seed=2)


def test_shots_of_different_batches_are_different() -> None:
    body = "qreg q[12]; creg c[12]; h q; measure q -> c;"  # 1,024 shots at a time
    found = counts(body, 2048)
    assert len(found) > 1100  # of 4096 values; 1611 are expected, 906 if the batches were alike


@pytest.mark.parametrize("shots", [0, -1, MAX_SHOTS + 1])
def test_too_many_shots_are_refused(shots: int) -> None:
    with pytest.raises(CircuitError, match="choose 1 to 1,000,000"):
        counts("qreg q[1];", shots)


def test_results_that_would_fill_the_memory_are_refused() -> None:
    with pytest.raises(CircuitError, match="choose at most 65,536 shots"):
        counts("qreg q[1]; creg c[4096];", MAX_SHOTS)


@pytest.mark.parametrize("name", [name for name in BACKENDS if name != "dense"])
def test_a_gate_that_is_not_clifford_is_refused_with_the_reason(name: str) -> None:
    with pytest.raises(CircuitError, match=rf"T is not a Clifford gate, which {name} cannot"):
        counts("qreg q[1]; creg c[1]; if(c==1) t q;", backend=name)
    with pytest.raises(CircuitError, match=r"RX\(0.3\) is not a Clifford gate"):
        counts("qreg q[1]; rx(0.3) q;", backend=name)


class RandomCircuit:
    """Gates, measurements and conditions on either; every measurement has a bit of its own."""

    def __init__(self, random: Generator, length: int) -> None:
        """Choose a number of operations."""
        self._random, self._bits = random, iter(range(BITS))
        mixed = tuple(Gate("H", (qubit,)) for qubit in range(QUBITS))
        operations = mixed + tuple(self._operation() for _ in range(length))
        self.circuit = Circuit(QUBITS, REGISTERS, operations)

    def _operation(self, depth: int = 0) -> Operation:
        random, kind = self._random, self._random.integers(12)
        first, second = (int(qubit) for qubit in random.permutation(QUBITS)[:2])
        if kind < 2 and depth < 2:
            register = REGISTERS[random.integers(len(REGISTERS))]
            inner = tuple(self._operation(depth + 1) for _ in range(random.integers(1, 3)))
            return If(register, int(random.integers(2**register.size)), inner)
        if kind < 4 and (bit := next(self._bits, None)) is not None:
            return Measure(first, bit)
        if kind < 8:
            return Gate(str(random.choice(["CX", "CZ"])), (first, second))
        return Gate(str(random.choice(["H", "S", "S_DAG", *PAULIS])), (first,))


class Oracle:
    """One shot on stim, made to find what we found wherever it is free to."""

    def __init__(self, found: Bytes) -> None:
        """Begin a shot of which these were the final bits."""
        self.simulator, self.found = stim.TableauSimulator(), found.tolist()
        self.bits, self.free = [0] * len(found), 0

    def run(self, operations: tuple[Operation, ...]) -> None:
        """Do operations."""
        for operation in operations:
            match operation:
                case Gate("I"):
                    pass
                case Gate(name, qubits):
                    getattr(self.simulator, name.lower())(*qubits)
                case Measure(qubit, bit):
                    self._measure(qubit, bit)
                case If(register, value, inner):
                    own = self.bits[register.first : register.first + register.size]
                    if sum(bit << place for place, bit in enumerate(own)) == value:
                        self.run(inner)

    def _measure(self, qubit: int, bit: int) -> None:
        outcome, expected = self.found[bit], self.simulator.peek_z(qubit)
        assert expected in (0, 1 - 2 * outcome)
        self.free += expected == 0
        self.simulator.postselect_z(qubit, desired_value=bool(outcome))
        self.bits[bit] = outcome


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("seed", range(20))
def test_random_circuits_with_feed_forward_agree_with_stim(seed: int, backend: str) -> None:
    random, free = np.random.default_rng(seed), 0
    for _ in range(5):
        circuit = RandomCircuit(random, 60).circuit
        (bits,) = run_circuit(circuit, BACKENDS[backend], 8, seed)
        for shot in bits.T:
            oracle = Oracle(shot)
            oracle.run(circuit.operations)
            assert oracle.bits == shot.tolist()
            free += oracle.free
    assert free > 50
