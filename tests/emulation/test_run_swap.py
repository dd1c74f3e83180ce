"""`qmn run swap` from outside: a chain of repeaters over the real components."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT


def run(runs: Path, *options: str) -> dict[str, Any]:
    """Run it to its end; return the result."""
    command = [sys.executable, "-m", "qmn", "run", "swap", "--runs", str(runs), *options]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=90
    )
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


@pytest.mark.parametrize("repeaters", [1, 3])
def test_pairs_come_by_way_of_repeaters(tmp_path: Path, repeaters: int) -> None:
    result = run(tmp_path, "--repeaters", str(repeaters), "--count", "1000")
    assert result["delivered"] is True
    alice, bob = result["asking"], result["asked"]
    assert (alice["pairs"], alice["fidelity"]) == (bob["pairs"], bob["fidelity"]) == (1000, 1)
    assert bob["waited_ms"] > 0
    assert result["path_setup_ms"]["n"] == repeaters + 1  # a path for each link


def test_a_pair_source_host_with_two_fibres_can_be_the_repeater(tmp_path: Path) -> None:
    result = run(tmp_path, "--topology", "sdc", "--count", "500")
    assert (result["asking"]["pairs"], result["asking"]["fidelity"]) == (500, 1)
