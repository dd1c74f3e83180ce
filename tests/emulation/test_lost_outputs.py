"""A run whose terminal or output is lost ends in order; that nothing is left the fixture checks."""

import os
import pty
import signal
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, in_runs, qmn_command, wait_until
from limits import PROGRAM_S
from test_faults import SLOW

from qmn.results import schema


def long_run(folder: Path) -> list[str]:
    """Return the command of a run that lasts much longer than the test."""
    file = folder / "long"
    file.write_bytes(bytes(40 << 20))
    return [*qmn_command(folder), "--file", str(file), *SLOW]


def shown_until(terminal: int, text: str) -> None:
    """Read what a terminal shows until this is."""
    shown = ""
    while text not in shown:
        shown += os.read(terminal, 4096).decode()


def begun() -> bool:
    """Whether the network has programs."""
    return bool(in_runs("*/dispatcher.json"))


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize(
    ("moment", "hangup", "status"),
    [
        ("start", signal.SIG_DFL, 128 + signal.SIGHUP),
        ("session", signal.SIG_DFL, 128 + signal.SIGHUP),
        ("session", signal.SIG_IGN, 128 + signal.SIGTERM),
    ],
    ids=["at the start", "in the session", "in the session of nohup, then SIGTERM"],
)
def test_a_terminal_that_closes_leaves_nothing(
    tmp_path: Path, moment: str, hangup: signal.Handlers, status: int
) -> None:
    command = long_run(tmp_path)
    before = signal.signal(signal.SIGHUP, hangup)
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(ROOT)
        os.execv(command[0], command)  # noqa: S606
    signal.signal(signal.SIGHUP, before)
    shown_until(terminal, "starting the network" if moment == "start" else "sending long")
    wait_until(begun, "there is something to clean up")
    os.close(terminal)
    if hangup is signal.SIG_IGN:
        os.kill(pid, signal.SIGTERM)
    _pid, ended = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(ended) == status
    (result,) = tmp_path.glob("2*/result.json")
    number = signal.Signals(status - 128).name
    causes = [f"interrupted by {number}"]
    if hangup is signal.SIG_IGN:  # its bar of progress may come first
        causes.append("standard output cannot be written: Input/output error")
    assert schema.read_left(result.parent).error in causes


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize(
    ("outputs", "words"),
    [
        (">/dev/full", "qmn: standard output cannot be written: No space left on device\n"),
        (">&-", "qmn: standard output cannot be written: Bad file descriptor\n"),
        (">/dev/full 2>/dev/full", ""),
        (">&- 2>&- <&-", ""),
    ],
)
def test_an_output_that_cannot_be_written_ends_a_run_in_order(
    tmp_path: Path, outputs: str, words: str
) -> None:
    command = [*qmn_command(tmp_path), "--message", "unheard"]
    done = subprocess.run(
        ["bash", "-c", f'"$@" {outputs}', "bash", *command],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PROGRAM_S,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", words)


def test_a_reader_that_goes_ends_a_run_as_it_ends_others(tmp_path: Path) -> None:
    """Its status is that of what SIGPIPE, number 13, has ended: 128 + 13 (POSIX sh)."""
    with subprocess.Popen(
        [*qmn_command(tmp_path), "--message", "half heard"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as run:
        assert run.stdout is not None
        assert "starting the network" in run.stdout.readline()
        run.stdout.close()
        assert run.wait(PROGRAM_S) == 128 + signal.SIGPIPE
        assert run.stderr is not None
        assert run.stderr.read() == ""
