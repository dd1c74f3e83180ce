"""Each file of tests is collected and run by one worker of pytest-xdist."""

import os
import subprocess
import sys
from pathlib import Path

from files_of_workers import shares
from limits import SOON_S

ROOT = Path(__file__).parents[2]


def write(folder: Path, sizes: dict[str, int], body: str) -> list[Path]:
    files = [folder / f"test_{name}.py" for name in sizes]
    for file, size in zip(files, sizes.values(), strict=True):
        file.write_text(body + "#" * (size - len(body)))
    return files


def run(folder: Path) -> "subprocess.CompletedProcess[str]":
    options = (
        "-n",
        "2",
        "--dist=each",
        "-p",
        "files_of_workers",
        "-p",
        "progress",
        "--max-worker-restart=0",
    )
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-c", os.devnull, *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    return subprocess.run(
        [*command, str(folder)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=SOON_S,
    )


def test_the_largest_files_go_to_those_who_have_least(tmp_path: Path) -> None:
    five, four, three, two = write(tmp_path, {"a": 50, "b": 40, "c": 30, "d": 20}, "")
    assert shares([two, four, five, three], 2) == [{five, two}, {four, three}]
    assert shares([five], 2) == [{five}, set()]


def test_every_test_runs_once(tmp_path: Path) -> None:
    body = "from pathlib import Path\ndef test_it(): Path(__file__ + '.ran').open('a').write('x')\n"
    files = write(tmp_path, {"a": 200, "b": 201, "c": 202}, body)
    done = run(tmp_path)
    assert "3 passed" in done.stdout
    assert "[100%]" in done.stdout
    assert [Path(f"{file}.ran").read_text() for file in files] == ["x"] * 3


def test_a_worker_that_dies_is_a_failure_and_no_wait(tmp_path: Path) -> None:
    write(tmp_path, {"a": 200, "b": 201}, "import os\ndef test_it(): os._exit(3)\n")
    done = run(tmp_path)
    assert done.returncode == 1
    assert "crashed while running" in done.stdout
