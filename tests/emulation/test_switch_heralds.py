"""Pairs that stations in switches herald, over the real components, beside closed forms."""

from math import sqrt
from pathlib import Path

import pytest
from test_run_heralded import FIDELITY, M_PER_S, OF_A_LINK, emitters
from test_run_nodes import polarised, require_estimate, result_of, run
from test_run_purified_chain import connected, purified

EMITTER = {"scheme": "two-click", "efficiency": "0.5", "fidelity": str(FIDELITY), "modes": "20"}


def switches(count: int) -> list[str]:
    """Return the options of a chain in which every second switch is a repeater, the rest stations.

    Hosts at its ends have the same emitters.
    """
    text = emitters("alice", "bob")
    for number in range(1, count + 1):
        parts = {"parts": "station", "detectors.dark_count_hz": "0"}
        if number % 2 == 0:
            parts = {"analysers": "1", "memories": "2", "memory.kind": "emissive"}
            parts |= {f"emitter.{name}": value for name, value in EMITTER.items()}
        text += [word for name in parts for word in ("--switch", f"q{number}.{name}={parts[name]}")]
    return [*text, "--topology", f"chain,{count}", "--count", "400", "--sample", "0.5"]


@pytest.mark.parametrize("count", [3, pytest.param(9, marks=pytest.mark.nightly)])
def test_switches_with_memories_that_emit_swap_heralded_links(tmp_path: Path, count: int) -> None:
    asking = result_of(tmp_path, "swap", *switches(count), "--length-km", "5")["job"]["asking"]
    require_estimate(asking, OF_A_LINK ** ((count + 1) // 2), 0.0)
    log = (tmp_path / "latest" / "quantum.log").read_text()
    stations = {line.split()[1] for line in log.splitlines() if " herald " in line}
    assert stations == {f"q{number}-analyser1" for number in range(1, count + 1, 2)}


@pytest.mark.parametrize(
    "schedule", ["nested", pytest.param("parallel", marks=pytest.mark.nightly)]
)
def test_heralded_pairs_are_purified_before_they_are_swapped(tmp_path: Path, schedule: str) -> None:
    """Links of two emitters are Werner pairs: two rounds of Deutsch et al., then one swap."""
    emitter = 0.92
    fidelity = (1 + 3 * polarised(emitter) ** 2) / 4
    wrong = (1 - fidelity) / 3
    expected, *_rest = connected(purified(purified((fidelity, wrong, wrong, wrong))))
    words = [*switches(3), "--schedule", schedule, "--purification", "none", "--purify", "2"]
    words += [f"--device={host}.emitter.fidelity={emitter}" for host in ("alice", "bob")]
    words += [f"--switch=q2.emitter.fidelity={emitter}", "--sample=0.6", "--count=300"]
    asking = result_of(tmp_path, "swap", *words)["job"]["asking"]
    assert (asking["pairs"], asking["span_rounds"], asking["rounds"]) == (300, 2, 0)
    require_estimate(asking, polarised(expected), 0.0)


def rarely(detectors: float) -> list[str]:
    """Return the options of a chain of which the second station's detectors see so little."""
    words = [*switches(3), "--switch", f"q3.detectors.efficiency={detectors}"]
    return [*words, "--block-pairs", "20", "--length-km", "5", "--sample", "0", "--count", "3"]


def heralds_of_q3(runs: Path) -> tuple[int, int]:
    """Return how many blocks its station has reported, and how many without a pair."""
    lines = (runs / "latest" / "quantum.log").read_text().splitlines()
    heralds = [line for line in lines if "q3-analyser1 herald " in line]
    return len(heralds), sum("photons=" not in line for line in heralds)


def test_a_chain_goes_on_behind_blocks_of_which_a_link_heralds_nothing(tmp_path: Path) -> None:
    """In a minute of round trips, 20 at once, there is half a pair: none with e^-0.5 = 0.61."""
    attempts = 20 * 60 / (2 * 5e3 / M_PER_S)
    passed = 0.5 * 10 ** (-0.2 * 5 / 10)
    detectors = sqrt(2 * 0.5 / attempts) / passed
    asking = result_of(tmp_path, "swap", *rarely(detectors))["job"]["asking"]
    assert asking["pairs"] == 3
    heralds, empty = heralds_of_q3(tmp_path)
    assert 0 < empty < heralds
    assert heralds - empty <= asking["shared"] == asking["emitted"]


def test_pairs_that_a_switch_cuts_off_are_made_again(tmp_path: Path) -> None:
    """The second link takes as long on average as q2 keeps what the first one heralds at once."""
    cutoff_s, passed = 0.1, 0.5 * 10 ** (-0.2 * 5 / 10)
    attempts = 20 * cutoff_s / (2 * 5e3 / M_PER_S)
    words = rarely(sqrt(2 / attempts) / passed)
    words += ["--block-pairs", "1", "--count", "8", "--switch", f"q2.memory.cutoff_s={cutoff_s}"]
    asking = result_of(tmp_path, "swap", *words)["job"]["asking"]
    log = (tmp_path / "latest" / "quantum.log").read_text()
    assert asking["pairs"] == 8
    assert log.count(" expire ") > 0


@pytest.mark.nightly
def test_a_link_that_never_heralds_ends_the_session_after_ten_blocks(tmp_path: Path) -> None:
    done = run(tmp_path, "swap", *rarely(1e-12))
    assert done.returncode == 1
    assert "no pair of the last 10 blocks of light has arrived at both ends" in done.stderr
    assert heralds_of_q3(tmp_path) == (10, 10)
