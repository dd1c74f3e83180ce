"""The core without the packages around it."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
AROUND = ("applications", "course", "evidence")
NOT_COPIED = {*AROUND, *(f"{name}.dist-info" for name in AROUND), "labs", "runs", ".git", ".venv"}
CORE_TESTS = (
    "copper",
    "programs",
    "qmn/test_registered.py",
    "qmn/test_run_input.py",
    "qmn/test_result.py",
    "topologies/test_causality.py",
)


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the tree without the packages around the core."""
    copy = tmp_path_factory.mktemp("core") / "qmn"

    def left_out(folder: str, names: list[str]) -> set[str]:
        return NOT_COPIED.intersection(names) if folder == str(ROOT) else {"__pycache__"}

    shutil.copytree(ROOT, copy, ignore=left_out)
    (copy / ".venv").symlink_to(ROOT / ".venv")
    return copy


def test_a_message_is_sent_by_the_core_alone(core: Path, tmp_path: Path) -> None:
    command = ["bin/qmn", "run", "sdc", "--message", "alone", "--runs", str(tmp_path)]
    done = subprocess.run(command, cwd=core, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    (run,) = tmp_path.glob("*-sdc")
    assert json.loads((run / "result.json").read_text())["delivered"] is True
    assert (run / "report.html").exists()
    usage = subprocess.run(["bin/qmn", "--help"], cwd=core, capture_output=True, text=True)
    assert "netqasm" not in usage.stdout
    assert "make experiments" not in usage.stdout


@pytest.mark.nightly
def test_the_tests_of_the_core_pass_alone(core: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    tests = [f"tests/unit/{name}" for name in CORE_TESTS]
    done = subprocess.run(
        [*command, *tests],
        cwd=core,
        env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "PYTHONPATH": f"{core}:{core}/tests"},
        capture_output=True,
        text=True,
        timeout=250,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr
