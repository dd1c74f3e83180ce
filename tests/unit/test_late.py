"""A test that failed is repeated alone once, and reported as late if it passes."""

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
# Fails as often as a file says, then passes.
UNSTEADY = """
from pathlib import Path
left = Path(__file__).with_name("left")
def test_unsteady():
    number = int(left.read_text())
    left.write_text(str(number - 1))
    assert number <= 0, "waited for a cup of tea"
def test_steady():
    pass
"""


def run(folder: Path, failures: int, *words: str) -> subprocess.CompletedProcess[str]:
    """Run two tests, of which one fails so often."""
    (folder / "test_it.py").write_text(UNSTEADY)
    (folder / "left").write_text(str(failures))
    (folder / "pytest.ini").touch()
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "late", *words]
    return subprocess.run(
        command,
        cwd=folder,
        env={"PYTHONPATH": str(TESTS), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("words", [(), ("-n", "2")])
def test_what_passes_alone_is_late_with_its_reason(tmp_path: Path, words: tuple[str, ...]) -> None:
    done = run(tmp_path, 1, *words)
    assert done.returncode == 0, done.stdout
    assert "late test_it.py::test_unsteady: " in done.stdout
    assert "waited for a cup of tea" in done.stdout
    assert "1 passed, 1 late" in done.stdout


def test_what_fails_alone_as_well_has_failed(tmp_path: Path) -> None:
    done = run(tmp_path, 2)
    assert done.returncode == 1
    assert "1 failed, 1 passed" in done.stdout


def test_what_is_late_twice_in_a_row_has_failed(tmp_path: Path) -> None:
    for status in (0, 1):
        assert run(tmp_path, 1).returncode == status
    assert run(tmp_path, 0).returncode == 0  # a run without it ends the row
    assert run(tmp_path, 1).returncode == 0


def test_the_test_is_repeated_by_the_words_before_it(tmp_path: Path) -> None:
    assert run(tmp_path, 1, "--alone=env").returncode == 0
    assert run(tmp_path, 1, "--alone=false").returncode == 1
