"""`qmn run sense` from outside: three hosts learn the sum of their phases."""

import json
from math import sqrt
from pathlib import Path

import pytest
from loaded import run_qmn

PHASES = {"alice": 0.4, "bob": -1.1, "charlie": 2.0}  # sum 1.3
COUNT = 4000


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(("probes", "least"), [("ghz", 1.0), ("separate", sqrt(3))])
def test_the_sum_of_phases_is_told_at_the_limit_of_its_probes(
    tmp_path: Path, probes: str, least: float
) -> None:
    """1 / sqrt(M) by M states, sqrt(3) times that by as many probes of each of three hosts."""
    words = [f"--device={name}.sensor.phase_rad={phase}" for name, phase in PHASES.items()]
    words += [
        "--probes",
        probes,
        "--count",
        str(COUNT),
        "--captures",
        "none",
        "--without",
        "report",
    ]
    done = run_qmn("run", "sense", *words, "--runs", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    report = result["job"]["asking"]
    assert result["parameters"]["phases_rad"] == list(PHASES.values())
    assert report["states"] == COUNT
    assert abs(report["sum_rad"] - 1.3) < 5 * least / sqrt(COUNT)
    assert abs(report["sum_error_rad"] / (least / sqrt(COUNT)) - 1) < 5 * sqrt(1 / 250)
