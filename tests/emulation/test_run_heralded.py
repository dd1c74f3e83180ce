"""Pairs that a station in a switch heralds, over the real components, beside closed forms."""

from math import sqrt
from pathlib import Path

from test_run_nodes import require_estimate, result_of

M_PER_S = 2.04e8  # of light in fibre
KM = 50.0
FIDELITY = 0.98  # of each qubit and its photon
OF_A_LINK = (4 * (FIDELITY**2 + (1 - FIDELITY) ** 2 / 3) - 1) / 3  # polarised


STATION = ["--switch", "q1.parts=station", "--switch", "q1.detectors.dark_count_hz=0"]


def emitters(*hosts: str) -> list[str]:
    """Return the options by which hosts have memories that emit, and no other source."""
    parts = {
        "source.statistics": "none",
        "emitter.scheme": "two-click",
        "emitter.efficiency": "0.5",
        "emitter.fidelity": str(FIDELITY),
        "emitter.modes": "20",
    }
    reports = [f"{host}.{name}={value}" for host in hosts for name, value in parts.items()]
    return [word for part in reports for word in ("--device", part)]


def test_pairs_are_heralded_at_the_rate_of_round_trips_to_the_station(tmp_path: Path) -> None:
    words = ["distribute", *STATION, *emitters("alice", "bob"), "--count", "400"]
    words += ["--sample", "0.5"]
    report = result_of(tmp_path, *words, "--length-km", str(KM), "--loss-db-per-km", "0.02")
    asking = report["job"]["asking"]
    efficiency = 0.5 * 10 ** (-KM * 0.02 / 10)
    p = efficiency**2 / 2
    expected = p * asking["attempts"]
    assert abs(asking["emitted"] - expected) < 5 * sqrt(expected) + 20 * p
    least_s = asking["attempts"] / 20 * 2 * KM * 1e3 / M_PER_S
    assert asking["elapsed_s"] > 0.99 * least_s  # and beside it messages and programs
    require_estimate(asking, OF_A_LINK, 0.0)


def test_rotations_on_the_way_to_a_station_are_undone(tmp_path: Path) -> None:
    """bob's light passes a switch that flips bits: no pair of perfect memories errs for it."""
    words = ["distribute", *STATION, *emitters("alice", "bob"), "--topology", "chain,2"]
    words += [f"--device={host}.emitter.fidelity=1" for host in ("alice", "bob")]
    words += ["--switch", "q2.rotation=1", "--count", "200", "--sample", "0.5"]
    assert result_of(tmp_path, *words)["job"]["asking"]["fidelity"] == 1
