"""Pairs that a station heralds, over the real components, beside p c / 2L and closed forms."""

from math import sqrt
from pathlib import Path

import pytest
from test_run_nodes import require_estimate, result_of

CHAIN = ["swap", "--topology", "repeaters,stations", "--count", "400", "--sample", "0.5"]
M_PER_S = 2.04e8  # of light in fibre
KM = 50.0
BLOCK = 50
FIDELITY = 0.98  # of each qubit and its photon
OF_A_LINK = (4 * (FIDELITY**2 + (1 - FIDELITY) ** 2 / 3) - 1) / 3  # polarised


def emitters(*hosts: str) -> list[str]:
    """Return the options by which hosts have memories that emit, and no other source."""
    parts = {
        "source.statistics": "none",
        "emitter.scheme": "two-click",
        "emitter.efficiency": "0.5",
        "emitter.fidelity": str(FIDELITY),
        "emitter.modes": "20",
    }
    told = [f"{host}.{name}={value}" for host in hosts for name, value in parts.items()]
    return [word for part in told for word in ("--device", part)]


def test_pairs_are_heralded_at_the_rate_of_round_trips_to_the_station(tmp_path: Path) -> None:
    words = ["distribute", "--node", "charlie=station", *emitters("alice", "bob"), "--count", "400"]
    words += ["--device", "charlie.detectors.dark_count_hz=0", "--sample", "0.5"]
    told = result_of(tmp_path, *words, "--length-km", str(KM), "--loss-db-per-km", "0.02")
    asking = told["job"]["asking"]
    efficiency = 0.5 * 10 ** (-2 * KM * 0.02 / 10)  # two fibres to the station
    p = efficiency**2 / 2
    expected = p * asking["attempts"]
    assert abs(asking["emitted"] - expected) < 5 * sqrt(expected) + 20 * p
    least_s = asking["attempts"] / 20 * 2 * (2 * KM * 1e3) / M_PER_S
    assert asking["elapsed_s"] > 0.99 * least_s  # and beside it messages and programs
    require_estimate(asking, OF_A_LINK, 0.0)


@pytest.mark.nightly
def test_links_of_a_chain_are_heralded_by_stations_of_their_own(tmp_path: Path) -> None:
    hosts = emitters("alice", "r1", "bob")
    words = [*CHAIN, *hosts, "--length-km", "5"]
    told = result_of(tmp_path, *words)
    require_estimate(told["job"]["asking"], OF_A_LINK**2, 0.0)
    log = (tmp_path / "latest" / "quantum.log").read_text()
    assert {"m1", "m2"} == {line.split()[1] for line in log.splitlines() if " herald " in line}


@pytest.mark.by_day(every=2)
@pytest.mark.waits
@pytest.mark.parametrize(
    ("capacity", "deeds"),
    [
        (8 * BLOCK, ["attempt", "attempt"]),
        (4 * BLOCK - 1, ["attempt", "measure"]),  # one at a time: two would not fit
    ],
)
def test_blocks_of_a_heralded_chain_follow_each_other(
    tmp_path: Path, capacity: int, deeds: list[str]
) -> None:
    """alice attempts for the second block before she measures the sample of the first one."""
    hosts = [*emitters("alice", "r1", "bob"), "--device", f"r1.memory.capacity={capacity}"]
    words = [*CHAIN, *hosts, "--length-km", "20"]
    words += ["--block-pairs", str(BLOCK), "--time", "paced=100"]
    told = result_of(tmp_path, *words)
    require_estimate(told["job"]["asking"], OF_A_LINK**2, 0.0)
    lines = [
        line.split() for line in (tmp_path / "latest" / "quantum.log").read_text().splitlines()
    ]
    kinds = [line[2] for line in lines if line[1] == "alice"]
    assert [kind for kind in kinds if kind in ("attempt", "measure")][:2] == deeds
