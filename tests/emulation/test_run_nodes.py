"""Distribution and teleportation on ion-trap-like nodes, over the real components.

Fidelities are held against the closed form of the devices' numbers, within 5 standard errors.
"""

import json
import subprocess
from math import exp, log10, sqrt
from pathlib import Path
from typing import Any

import pytest
from loaded import run_qmn

from topologies.catalogue.node_kinds import ION_TRAP

PAIR, RATE_HZ = 0.96, 250
SOURCE = {"statistics": "single", "fidelity": PAIR, "max_rate_hz": RATE_HZ}
BELL_GATES = (1 - ION_TRAP.gates.one_qubit_depolarizing) * (
    1 - ION_TRAP.gates.two_qubit_depolarizing
)
READ = 1 - 2 * ION_TRAP.gates.readout_error  # what a reading leaves of a correlation
BITS = READ ** (4 / 3)  # two bits that correct: of three correlations they flip one, one, or both
BLOCK_S = ION_TRAP.memory.capacity / RATE_HZ


def run(runs: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a service to its end."""
    return run_qmn("run", *words, "--without", "report", "--runs", str(runs))


def result_of(runs: Path, *words: str) -> dict[str, Any]:
    """Run a service that succeeds; return its result."""
    done = run(runs, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    assert result["delivered"] is True
    assert result["exact"] is True
    return result


def with_source(*hosts: str) -> list[str]:
    """Return the words that give hosts a source of pairs, which no ion trap is by itself.

    Others take in its light, which no ion does either.
    """
    lines = [f"{host}.source.{name}={value}" for host in hosts for name, value in SOURCE.items()]
    lines += [f"{host}.memory.kind=absorptive" for host in {*hosts, "bob"}]
    return [word for each in lines for word in ("--device", each)]


def polarised(fidelity: float) -> float:
    """Return how much of a Werner pair is Phi+, the rest being white noise."""
    return (4 * fidelity - 1) / 3


def waiting(polarisation: float, wait_s: float) -> float:
    """Return the fidelity of a pair to Phi+ when its halves have waited so long, added up."""
    coherence = exp(-wait_s / ION_TRAP.memory.t2_s)
    return (1 + polarisation * (1 + 2 * coherence)) / 4


def require_estimate(summary: dict[str, Any], polarisation: float, most_wait_s: float) -> None:
    """Hold the estimate of a fidelity against theory: F = (3 q - 1) / 2 of right outcomes."""
    least, most = (waiting(polarisation, wait_s) for wait_s in (most_wait_s, 0.0))
    right = (2 * least + 1) / 3
    error = 1.5 * sqrt(right * (1 - right) / summary["sampled"])
    assert summary["sampled"] >= 300
    assert least - 5 * error < summary["fidelity"] < most + 5 * error, (least, most)


def test_two_ion_traps_and_a_fibre_are_enough_for_pairs(tmp_path: Path) -> None:
    words = ["--node", "ion-trap", *with_source("alice")]
    words += ["--source", "alice", "--count", "16", "--fidelity", "0.8"]
    result = result_of(tmp_path, "distribute", *words)
    alice = result["job"]["asking"]
    assert alice["pairs"] == result["job"]["asked"]["pairs"] == 16
    require_estimate(alice, polarised(PAIR) * READ**2, 2 * alice["elapsed_s"])
    assert result["parameters"]["rate_hz"] == RATE_HZ


@pytest.mark.nightly
def test_an_ion_trap_makes_no_pairs_at_will(tmp_path: Path) -> None:
    """However far: who asks hears what there has to be in its place."""
    words = ["--node", "ion-trap", "--source", "alice", "--length-km", "1000", "--count", "12"]
    words += ["--device", "bob.memory.kind=absorptive"]  # nor takes it in light of others
    done = run(tmp_path, "distribute", *words)
    assert done.returncode == 1
    assert "distribute: alice has no source of light (feature emit)" in done.stderr
    assert "memories that emit share pairs by a station (docs/nodes.md)" in done.stderr


@pytest.mark.nightly
def test_spins_that_emit_take_in_no_light_of_another_source(tmp_path: Path) -> None:
    """Each of ten photons of a source was kept by a spin in diamond, as if it were absorbed."""
    words = ["--node", "nv-centre", "--node", "charlie=photonic", "--count", "10", "--sample", "0"]
    words += ["--source", "charlie"]
    done = run(tmp_path, "distribute", *words)
    assert done.returncode == 1
    assert "distribute: alice has a memory that emits, and takes in no light" in done.stderr
    assert "(feature absorb): let a station herald pairs" in done.stderr


@pytest.mark.nightly
@pytest.mark.waits
def test_heralds_for_ion_traps_come_the_slower_the_longer_the_fibres(tmp_path: Path) -> None:
    """Two clicks: an attempt is heralded with eta^2 / 2, and takes a round trip to the station."""
    length_km, count = 100.0, 4
    words = ["--node", "ion-trap", "--time", "paced"]
    words += ["--length-km", str(length_km), "--loss-db-per-km", "0", "--sample", "0"]
    words += ["--switch", "insertion_loss_db=0", "--count", str(count)]
    alice = result_of(tmp_path, "distribute", *words)["job"]["asking"]
    chance = ION_TRAP.emitter.efficiency**2 / 2
    # Each failure costs a round trip, and of the attempts there are `modes` at a time.
    expected = count / chance
    assert abs(alice["attempts"] - expected) < 5 * sqrt(count) / chance
    round_trip_s = 2 * length_km * 1e3 / 2.04e8
    assert alice["elapsed_s"] >= alice["attempts"] * round_trip_s / ION_TRAP.emitter.modes * 0.99


@pytest.mark.nightly
def test_ion_traps_teleport(tmp_path: Path) -> None:
    words = ["--node", "ion-trap", *with_source("alice"), "--source", "alice", "--count", "1000"]
    alice = result_of(tmp_path, "teleport", *words)["job"]["asking"]
    assert alice["arrived"] == 1000
    waited_s = 2 * alice["waited_ms"] / 1000 + BLOCK_S  # alice's halves wait for the light, too
    expected = (2 * waiting(polarised(PAIR) * BELL_GATES * BITS * READ, waited_s) + 1) / 3
    assert abs(alice["fidelity"] - expected) < 5 * sqrt(expected * (1 - expected) / 1000)


def log_of(runs: Path) -> list[str]:
    """Return what happened to qubits, a line an event."""
    return (runs / "latest" / "quantum.log").read_text().splitlines()


@pytest.mark.nightly
def test_a_memory_that_heralds_badly_is_given_less_and_delivers_empty_places(
    tmp_path: Path,
) -> None:
    """Half of the light comes; T e + (1 - T) f of the pairs are shared, and T e of those there."""
    passed, seen, mistaken, count = 0.5, 0.8, 0.1, 20_000
    shared = passed * seen + (1 - passed) * mistaken
    empty = (1 - passed) * mistaken / shared
    words = ["--length-km", "0.01", "--loss-db-per-km", "0", "--switch", "insertion_loss_db=0"]
    words += ["--fiber", f"bob-q1.loss_db_per_km={-10 * log10(passed) / 0.01}"]
    words += ["--device", f"bob.memory.herald_efficiency={seen}"]
    words += ["--device", f"bob.memory.false_herald={mistaken}"]
    result = result_of(tmp_path, "distribute", "--count", str(count), *words)
    alice = result["job"]["asking"]
    assert alice["pairs"] == result["job"]["asked"]["pairs"] == count
    error = sqrt(shared * (1 - shared) / alice["emitted"])
    assert abs(alice["shared"] / alice["emitted"] - shared) < 5 * error
    gathered = [line for line in log_of(tmp_path) if " bob " in line and " gather " in line]
    (delivered,) = [line for line in gathered if f"photons={count} " in line]
    found = int(delivered.partition("lost=")[2].split()[0])
    assert abs(found - count * empty) < 5 * sqrt(count * empty * (1 - empty))
    assert alice["fidelity"] == 1  # of those that were read
