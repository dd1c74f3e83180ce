"""`qmn run ghz` from outside: states of three hosts over fibres that depolarise."""

import json
from pathlib import Path

from loaded import run_qmn

NOISE = 0.02


def test_the_fidelity_of_ghz_states_is_that_of_theory(tmp_path: Path) -> None:
    """Each half passes two fibres; all are equal in Z with (1 - p/2)^2, coherent with (1 - p)^2."""
    words = ["--depolarizing", str(NOISE), "--count", "20000", "--captures", "none"]
    done = run_qmn("run", "ghz", *words, "--no-report", "--runs", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    told, p = result["job"]["asking"], 1 - (1 - NOISE) ** 2
    expected = ((1 - p / 2) ** 2 + (1 - p) ** 2) / 2
    assert told["states"] >= 20_000
    assert abs(told["fidelity"] - expected) < 5 * told["fidelity_error"] < 0.015


def test_a_host_that_is_not_there_is_named_before_anything_starts(tmp_path: Path) -> None:
    done = run_qmn("run", "ghz", "--line", "alice,bob,zoe", "--runs", str(tmp_path))
    assert done.returncode != 0
    assert "zoe" in done.stdout + done.stderr
