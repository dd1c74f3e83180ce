"""A `qmn run` of its own, as a call: a process with a network, a job and a folder of results.

A run that hangs must be ended from outside, and jobs such as keys, vpn and load start networks of
their own.
"""

import os
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from qmn.needs import COMMAND
from qmn.options import BadInput
from qmn.results.run_result import RunResult
from qmn.results.schema import read_left
from qmn.scripting.job_result import JobResult
from qmn.timeouts import RUN_END_TIMEOUT_S, RUN_POLL_S
from topologies.system.processes.programs import NetworkError, cause

REPORT = re.compile(r"^qmn[a-z -]*: (?:error: )?(.*)", re.MULTILINE)  # a fault
USAGE = 2  # status of a command that cannot be
VERBS = ("netqasm",)  # jobs that are verbs beside `qmn run`


def run(job: str, *words: str, folder: Path | str | None = None, **options: Any) -> JobResult:
    """Do a job in a network of its own, as run("keys", seconds=30); return what it has left.

    Options are those of the command line, in Python's spelling; `words` come before them, as the
    folder of run("netqasm", "my-app"). The run leaves its folder in `folder`; without one nothing
    stays. Raise BadInput for what cannot be, NetworkError if it fails, in the words of `qmn`.
    """
    verb = [job] if job in VERBS else ["run", job]
    arguments = [word for name, value in options.items() for word in option_words(name, value)]
    with TemporaryDirectory(prefix="qmn-run-") as scratch:
        runs = Path(folder or scratch).absolute()
        command = [*verb, *words, *arguments, "--runs", str(runs)]
        left = carry_out(job, command, runs, Path(scratch) / "output")
        result = read_left(left)
    assert isinstance(result, RunResult)  # `qmn run` leaves no other
    return JobResult(**vars(result))


def option_words(name: str, value: Any) -> list[str]:
    """Return an option of the command line; it comes once for each element of a list."""
    flag = f"--{name.rstrip('_').replace('_', '-')}"
    if isinstance(value, bool):
        return [flag] if value else []
    values = value if isinstance(value, list | tuple) else [value]
    return [f"{flag}={each}" for each in values if each is not None]


def carry_out(
    name: str,
    words: list[str],
    runs: Path,
    output: Path,
    *,
    limit_s: float | None = None,
    check: Callable[[], None] = lambda: None,
) -> Path:
    """Run `qmn` with these words; return the folder that it has left in `runs`.

    Its output goes into a file. Raise BadInput or NetworkError; `check` may end it by raising.
    """
    before = _folders(runs)  # of one that was interrupted
    with output.open("w") as log:
        # Ctrl-C is ours to pass on: the run then cleans up.
        process = subprocess.Popen(
            [COMMAND, *words],
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            _wait(process, name, limit_s, check)
        finally:
            _end(process)
    if process.returncode:
        kind = BadInput if process.returncode == USAGE else NetworkError
        raise kind(f"{name}: {_why(output.read_text())}")
    left = _folders(runs) - before
    if len(left) > 1:
        raise NetworkError(
            f"{name}: other runs began in {runs} meanwhile: give each its own folder"
        )
    return left.pop()


def _folders(runs: Path) -> set[Path]:
    paths = runs.iterdir() if runs.exists() else ()
    return {path for path in paths if path.is_dir() and not path.is_symlink()}


def _why(output: str) -> str:
    """Return why a run has failed: what `qmn` reports, or the error that it did not handle."""
    return (REPORT.findall(output) or [cause(output)])[0] or "failed without a word"


def _wait(
    process: "subprocess.Popen[bytes]",
    name: str,
    limit_s: float | None,
    check: Callable[[], None],
) -> None:
    passed_s = 0.0
    while process.poll() is None:
        check()
        try:
            process.wait(RUN_POLL_S)
        except subprocess.TimeoutExpired:
            passed_s += RUN_POLL_S
            if limit_s is not None and passed_s >= limit_s:
                raise NetworkError(f"{name} has not ended after {limit_s:g} s") from None


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End a run that goes on: politely, so that nothing stays, then at once."""
    if process.poll() is not None:
        return
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(RUN_END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
