"""The exercises of the course, done as their solutions say (examples/solutions/).

The sixth needs a package: test_installed_wheel.py does it.
"""

import json
import subprocess
from pathlib import Path

import pytest

from topologies.system.processes.programs import ROOT

SOLUTIONS = ROOT / "examples" / "solutions"
SWAP = "swap --topology chain,3 --purify 1 --length-km 20 --count 300 --sample 0.5"
DONE = {
    1: [
        "sdc --depolarizing 0.01 --fec golay --interleave --frame-bytes 16 --message "
        + "qubits-" * 80
    ],
    2: ["sdc --app examples.solutions.drop_7777 --controller ryu"],
    3: ["qkd --count 20000 --eve 0.5 --topology tapped", "qkd --count 20000 --topology tapped"],
    4: [f"{SWAP} --schedule nested", f"{SWAP} --schedule parallel"],
    5: ["qkd --count 20000 --topology ring,switches=4"],
}


def qmn(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [ROOT / "bin" / "qmn", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.nightly
@pytest.mark.parametrize("number", DONE)
def test_a_solution_passes_and_half_of_it_does_not(number: int, tmp_path: Path) -> None:
    folders = []
    for place, words in enumerate(DONE[number]):
        runs = tmp_path / f"runs{place}"
        done = qmn(tmp_path, "run", *words.split(), "--runs", str(runs), "--without", "report")
        assert (runs / "latest" / "result.json").exists(), done.stderr
        folders += ["--run", str(runs / "latest")]
    answers = (SOLUTIONS / "answers.toml").read_text()
    if number == 4:
        waits = [
            json.loads((tmp_path / f"runs{place}/latest/result.json").read_text())["job"]
            for place in (0, 1)
        ]
        longer, shorter = (each["asking"]["sampled_waited_ms"] for each in waits)
        answers += f"waited_ratio = {longer / shorter:.3f}\n"
    (tmp_path / "answers.toml").write_text(answers)
    check = ["course", "check", str(number), *folders]
    passed = qmn(tmp_path, *check, "--answer", "answers.toml")
    assert passed.returncode == 0, passed.stdout + passed.stderr
    assert "missing" not in passed.stdout
    empty = qmn(tmp_path, "course", "check", str(number))
    assert (empty.returncode, "missing" in empty.stdout) == (1, True)
    if number not in (2, 5):  # they have no answers
        assert qmn(tmp_path, *check).returncode == 1
