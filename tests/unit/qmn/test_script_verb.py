"""A script that `qmn script` runs: its arguments, its status, and how it is interrupted."""

import subprocess
import sys
from pathlib import Path

import forked_python
import pytest
from limits import SOON_S

from qmn.verbs.script import MODULE

ROOT = Path(__file__).parents[3]
CTRL_C = "import os, signal; os.kill(os.getpid(), signal.SIGINT)"
STARTING = f"""
from topologies.system.processes.signals import Signals
with Signals() as signals:
    {CTRL_C}
    signals.check()
"""


def forked(file: Path, text: str) -> subprocess.CompletedProcess[str]:
    """Run a script of this text."""
    file.write_text(text)
    return forked_python.run([sys.executable, "-m", MODULE, str(file)], SOON_S, cwd=ROOT)


def run(file: Path, text: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a script of this text as the verb does."""
    file.write_text(text)
    command = [sys.executable, "-P", "-m", MODULE, str(file), *words]
    return subprocess.run(
        command,
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=SOON_S,
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (STARTING, "qmn: interrupted by SIGINT\n"),
        (CTRL_C, "qmn: interrupted\n"),
    ],
)
def test_an_interrupted_script_ends_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    """Its status is that of a program that SIGINT, number 2, has ended: 128 + 2 (POSIX sh)."""
    done = forked(tmp_path / "mine.py", text)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", words)


def test_a_script_is_the_main_program_with_its_arguments_and_neighbours(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text("WORD = 'found'")
    text = "import sys, beside_it\nprint(__name__, *sys.argv[1:], beside_it.WORD)\nsys.exit(7)"
    done = run(tmp_path / "mine.py", text, "--seed", "3")
    assert (done.returncode, done.stdout, done.stderr) == (7, "__main__ --seed 3 found\n", "")


@pytest.mark.parametrize("text", ["def f():\n    1/0\nf()\n", "def f(:\n"])
def test_a_fault_in_a_script_is_told_as_python_tells_it(tmp_path: Path, text: str) -> None:
    file = tmp_path / "mine.py"
    ours = run(file, text)
    pythons = subprocess.run([sys.executable, str(file)], capture_output=True, text=True)
    assert (ours.returncode, ours.stderr) == (pythons.returncode, pythons.stderr)
    assert "Error" in ours.stderr
