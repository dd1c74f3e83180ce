"""Dumps of the real dispatcher: they run, and find what the dispatcher found."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import uvloop
from dispatcher_network import Bench, JumpingClock, block, configuration, running, with_fibers

from applications.circuits.circuit import Circuit, Source
from applications.circuits.interpreter import run_circuit
from applications.circuits.qasm import read_qasm
from dispatcher.recording.writer import MAX_SOURCE_BYTES, PHOTONS
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.backends import BACKENDS
from wire.config import PathOptics, QuantumSwitch
from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    DiscardRequest,
    Gate,
    GatherRequest,
    MeasureRequest,
    Pick,
)
from wire.outcomes import NO_CLICK
from wire.positions import pack

SHOTS = 32


def dumped(folder: Path, act: Any, **changes: Any) -> tuple[str, Any]:
    """Let something happen in a noisy network; return the dump and what `act` returned."""
    file = folder / "quantum.qasm"
    config = replace(configuration(folder, qasm=str(file)), **changes)
    config = with_fibers(config, loss_db_per_km=100.0, depolarizing=0.4)

    async def run() -> Any:
        async with running(config, JumpingClock()) as bench:
            return await act(bench)

    found = uvloop.run(run())
    return file.read_text(), found


def run(text: str) -> tuple[Circuit, Bytes]:
    """Run a dump; return its circuit and the bits of all shots, shape (bits, shots)."""
    circuit = read_qasm(Source("quantum.qasm", text))
    (bits,) = run_circuit(circuit, BACKENDS["chp"], SHOTS, 1)
    return circuit, bits


def register(circuit: Circuit, bits: Bytes, index: int) -> Bytes:
    """Return the bits of one classical register, shape (size, shots)."""
    own = circuit.registers[index]
    return bits[own.first : own.first + own.size]


async def superdense(bench: Bench) -> bytes:
    """Send a message of 200 dibits by superdense coding; return bob's outcomes."""
    await bench.switch.connect((3, 4))
    await bench.alice.create(200)
    await bench.alice.apply(block(0, 1), bytes(n % 4 for n in range(200)))
    await bench.alice.send((block(0, 0), "alice-q9"), (block(0, 1), "alice-q0"))
    await bench.bob.receive(block(0, 0), "bob-q9")
    await bench.bob.receive(block(0, 1), "bob-q0")
    return (await bench.bob.bell_measure(block(0, 0), block(0, 1))).outcomes


def test_a_noisy_transmission_gives_the_same_outcomes_again(tmp_path: Path) -> None:
    text, outcomes = dumped(tmp_path, superdense)
    circuit, bits = run(text)
    phases, flips = (register(circuit, bits, index) for index in (0, 1))
    found = np.frombuffer(outcomes, np.uint8)[:PHOTONS]
    seen = found != NO_CLICK
    assert 10 < seen.sum() < PHOTONS
    wrong = found[seen] != (np.arange(PHOTONS) % 4)[seen]
    assert 3 < wrong.sum() < seen.sum() - 3  # so the dump's noise is that of the dispatcher
    for shot in range(SHOTS):
        again = flips[:, shot] | (phases[:, shot] << 1)
        assert (again[seen] == found[seen]).all()


async def prepared(bench: Bench) -> bytes:
    """Prepare the six cardinal states and measure each in its own basis."""
    states = bytes(n % 6 for n in range(30))
    create = CreateRequest(session=7, count=30, state=CreateRequest.PREPARED, states=states)
    await bench.alice.act(create)
    measure = MeasureRequest(block=block(), bases=bytes(n % 6 // 2 for n in range(30)))
    return (await bench.alice.act(measure)).outcomes


def test_prepared_photons_are_prepared_in_the_dump_too(tmp_path: Path) -> None:
    text, outcomes = dumped(tmp_path, prepared)
    _circuit, bits = run(text)
    assert list(outcomes) == [0, 1] * 15
    assert (bits == np.frombuffer(outcomes, np.uint8)[:, None]).all()


async def gathered(bench: Bench) -> list[bytes]:
    """Purify pairs of which some are not among the first photons, and measure what is left."""
    outcomes = []
    await bench.alice.create(100)
    await bench.alice.send((block(0, 1), "alice-q9"))
    await bench.bob.receive(block(0, 1), "bob-q9")
    for client, half in ((bench.alice, 0), (bench.bob, 1)):
        for number, photons in ((1, [90, *range(29, -1, -1)]), (2, [*range(30, 60), 91])):
            pick = Pick(block=block(0, half), photons=pack(photons))
            request = GatherRequest(into=block(number, half), picks=[pick], keep_rest=number == 1)
            await client.act(request)
        gate = Gate(name=Gate.CX, target=block(2, half))
        await client.act(ApplyRequest(block=block(1, half), gates=[gate]))
        outcomes.append((await client.measure(block(2, half))).outcomes)
    for client, half in ((bench.alice, 0), (bench.bob, 1)):
        outcomes.append((await client.measure(block(1, half), MeasureRequest.X)).outcomes)
    return outcomes


def test_kraus_operators_are_a_comment_of_the_dump(tmp_path: Path) -> None:
    damping = str(Path(__file__).parents[3] / "docs" / "noise-models" / "damping.py") + ":Damping"
    own: dict[str, Any] = {"noise": damping, "noise_parameters": {"gamma": 0.1}}
    fibers = with_fibers(configuration(tmp_path), **own).fibers
    text, _outcomes = dumped(tmp_path, gathered, fibers=fibers, backend="dense")
    assert text.count("Kraus operators, not written") > PHOTONS // 2
    run(text)


def test_gathered_photons_are_the_same_qubits_in_the_dump(tmp_path: Path) -> None:
    text, outcomes = dumped(tmp_path, gathered)
    assert "CX with a photon that is not written" in text
    circuit, bits = run(text)
    # At positions 1 to 29 both are written; alice's photons are all there.
    found = [np.frombuffer(outcome, np.uint8)[1:30] for outcome in outcomes]
    targets, controls = (
        (register(circuit, bits, n), register(circuit, bits, n + 1)) for n in (0, 2)
    )
    again = [*(bit[1:30] for bit in targets), *(bit[:29] for bit in controls)]
    there = (found[1] != NO_CLICK) & (found[3] != NO_CLICK)
    assert 10 < there.sum() < 29
    for alice, bob in ((0, 1), (2, 3)):
        agree = (found[alice] == found[bob])[there]
        assert 2 < (~agree).sum() < agree.sum()
        for shot in range(SHOTS):
            same = (again[alice] == again[bob])[there, shot]
            np.testing.assert_array_equal(same, agree)


def test_every_pauli_and_every_loss_says_where_it_comes_from(tmp_path: Path) -> None:
    switch = QuantumSwitch("q1", paths=[PathOptics(3, 4, rotation=1)])
    text, _outcomes = dumped(tmp_path, superdense, switches=[switch])
    lines = text.splitlines()
    paulis = [line for line in lines if re.match(r"[xz] ", line)]
    places = {re.sub(r"^.*// photon \d+, ", "", line) for line in paulis}
    session = "of session 0000000000000007"
    assert {f"alice: apply block 0/1 {session}", "X: rotation of q1, 3 -> 4"} < places
    assert "Z: Depolarizing in the fibre to bob-q9 of bob" in places
    first, last = (f"Depolarizing in the fibre to {end}" for end in ("3 of q1", "bob-q0 of bob"))
    assert f"Z: {first}, X: rotation of q1, 3 -> 4" in places
    assert f"X: rotation of q1, 3 -> 4, XZ: {last}" in places
    cancelled = f"X: {first}, X: rotation of q1, 3 -> 4: nothing together"
    assert any(line.endswith(cancelled) for line in lines if line.startswith("//"))
    lost = [line for line in lines if "lost" in line and line.startswith("reset")]
    assert {re.sub(r"^.*// photon \d+, ", "", line) for line in lost} == {
        "lost: Loss in the fibre to bob-q9 of bob",
        "lost: Loss in the fibre to 3 of q1",
        "lost: Loss in the fibre to bob-q0 of bob",
    }
    assert f"// alice: create block 0 {session}: 200 systems" in lines
    assert any(re.search(r"measure .*// pair \d+: Psi-, 11$", line) for line in lines)
    assert any(re.search(r"^// pair \d+: no coincidence$", line) for line in lines)
    assert "first 64 photons of each block" in text


async def everything(bench: Bench) -> list[bytes]:
    """Use gates, bases, parts, resets by reuse and discarded blocks."""
    outcomes = []
    for number in range(3):
        await bench.alice.create(30, number=number)
        await bench.alice.apply(block(number), bytes(n % 4 for n in range(30)))
    gates = [Gate(name=Gate.CX, target=block(1, 0)), Gate(name=Gate.S), Gate(name=Gate.H)]
    await bench.alice.act(ApplyRequest(block=block(0, 0), gates=gates))
    for name, basis in (
        (block(0, 0), MeasureRequest.X),
        (block(1, 0), MeasureRequest.X),
        (block(0, 1), MeasureRequest.Z),
        (block(1, 1), MeasureRequest.X),
    ):
        outcomes.append((await bench.alice.measure(name, basis)).outcomes)
    await bench.alice.discard(DiscardRequest(session=7))
    await bench.alice.create(30, number=5)
    tilts = [Gate(name=Gate.RY, angle_rad=1.0), Gate(name=Gate.RY, angle_rad=-1.0)]
    await bench.alice.act(ApplyRequest(block=block(5, 1), gates=tilts))
    for half in (0, 1):
        request = MeasureRequest(block=block(5, half), bases=bytes(n % 3 for n in range(30)))
        outcomes.append((await bench.alice.act(request)).outcomes)
    return outcomes


def test_all_operations_are_dumped(tmp_path: Path) -> None:
    text, found = dumped(tmp_path, everything)
    text = re.sub(r"ry\((.*?)\)", r"ry(0*\1)", text)  # they undo each other; chp cannot do them
    circuit, bits = run(text)
    assert circuit.qubits == 30 * 6  # those of the last block are used again
    assert len(circuit.registers) == len(found)
    # A random outcome may be determined with others: every such parity is as found.
    shots = np.concatenate([register(circuit, bits, i) for i in range(len(found))])
    ours = np.concatenate([np.frombuffer(outcome, np.uint8) for outcome in found])
    determined = 0
    for first in range(len(ours)):
        for second in range(first, len(ours)):
            parity = shots[first] ^ (shots[second] if second != first else 0)
            if (parity == parity[0]).all():
                determined += 1
                assert parity[0] == ours[first] ^ (ours[second] if second != first else 0)
    assert determined == 90


async def each_turned(bench: Bench) -> None:
    """Turn photons by angles of their own."""
    await bench.alice.create(3)
    turn = Gate(name=Gate.RY, angles_rad=[0.5, 0.0, -1.25])
    await bench.alice.act(ApplyRequest(block=block(0), gates=[turn]))


def test_angles_of_their_own_are_dumped_with_each_photon(tmp_path: Path) -> None:
    text, _found = dumped(tmp_path, each_turned, backend="dense")
    assert re.findall(r"ry\((\S+)\) \S+; // photon (\d)", text) == [
        ("0.5", "0"),
        ("0.0", "1"),
        ("-1.25", "2"),
    ]


async def many_blocks(bench: Bench) -> None:
    """Make more blocks than the file has room for, one after the other and at once."""
    for number in range(40):
        await bench.alice.create(100, number=number)
        if number < 20:
            for half in (0, 1):
                await bench.alice.measure(block(number, half))


def test_a_dump_stays_within_what_can_be_run(tmp_path: Path) -> None:
    text, _found = dumped(tmp_path, many_blocks)
    assert len(text) < MAX_SOURCE_BYTES
    circuit, bits = run(text)
    assert circuit.qubits <= 1000
    assert text.count("the file is full") == 1
    assert len(circuit.registers) == 40
    for number in range(20):
        halves = [register(circuit, bits, 2 * number + half) for half in (0, 1)]
        assert (halves[0] == halves[1]).all()
