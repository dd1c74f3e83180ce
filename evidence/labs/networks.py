"""The runs of a lab: each is a `qmn` of its own, one after the other.

A lab names each run by the command that a reader would type. It is a process of its own, as a
point of a sweep in networks is (evidence/curves/beside.py): a process has one network, a run that
hangs must be ended from outside, and a lab's own script may do anything to its process.
"""

import json
import os
import shlex
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

from evidence.labs.lab import Run
from qmn.needs import COMMAND
from qmn.timeouts import LAB_END_TIMEOUT_S, LAB_POLL_S, LAB_RUN_TIMEOUT_S
from topologies.system.processes.programs import NetworkError, cause
from wire.results.run_result import RESULT

REPORT = "qmn: "  # before a fault


def words_of(words: str, seed: int, runs: Path) -> list[str]:
    return [*shlex.split(words), "--seed", str(seed), "--runs", str(runs)]


def carry_out(name: str, words: str, seed: int, folder: Path, check: Callable[[], None]) -> Run:
    """Start a network, do its job, and return what it left in a folder of the lab's.

    Raise NetworkError if it fails; `check` may end it by raising.
    """
    runs = folder / name
    before = folders(runs)  # of one that was interrupted
    command = [COMMAND, *words_of(words, seed, runs)]
    with (folder / f"{name}.log").open("w") as log:
        # Ctrl-C is ours to pass on: the run then cleans up.
        process = subprocess.Popen(
            command,
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            _wait(process, name, check)
        finally:
            _end(process)
    if process.returncode:
        raise NetworkError(f"{name}: {_why(Path(log.name).read_text())}; see {log.name}")
    (left,) = folders(runs) - before
    return left_in(left)


def folders(runs: Path) -> set[Path]:
    found = runs.iterdir() if runs.exists() else ()
    return {path for path in found if path.is_dir() and not path.is_symlink()}


def left_in(folder: Path) -> Run:
    return Run(folder, json.loads((folder / RESULT).read_text()))


def _why(output: str) -> str:
    """Return why a run has failed: what `qmn` reports, or the error that it did not handle."""
    reports = [line.removeprefix(REPORT) for line in output.splitlines() if line.startswith(REPORT)]
    return (reports or [cause(output)])[0] or "failed without a word"


def _wait(process: "subprocess.Popen[bytes]", name: str, check: Callable[[], None]) -> None:
    left_s = LAB_RUN_TIMEOUT_S
    while process.poll() is None:
        check()
        try:
            process.wait(LAB_POLL_S)
        except subprocess.TimeoutExpired:
            left_s -= LAB_POLL_S
            if left_s <= 0:
                raise NetworkError(f"{name} has not ended after {LAB_RUN_TIMEOUT_S:g} s") from None


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End a run that goes on: politely, so that nothing stays, then at once."""
    if process.poll() is not None:
        return
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(LAB_END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
