"""A report that is drawn by a process beside the run."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from recorded_run import record_run

from qmn.reports.beside import report_beside
from qmn.reports.report_file import made_report
from topologies.owners import owner

DEADLINE_S = 60.0
# A runner that says which process draws its reports, and then waits.
RUNNER = """
import multiprocessing, sys
from qmn.reports.beside import report_beside
with report_beside():
    (drawer,) = multiprocessing.active_children()
    print(drawer.pid, flush=True)
    sys.stdin.read()
"""


def children() -> list[int]:
    return [
        int(pid)
        for pid in Path("/proc/self/task", str(os.getpid()), "children").read_text().split()
    ]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return record_run(tmp_path)


def test_it_is_the_report_that_a_run_is_drawn_by_itself(run: Path) -> None:
    with report_beside() as draw:
        assert draw(run) == str(run / "report.html")
    beside = (run / "report.html").read_text()
    assert made_report(run).read_text() == beside
    assert children() == []


def test_why_there_is_none_comes_from_there(run: Path) -> None:
    (run / "quantum.pcapng").write_bytes(b"this is not a capture")
    with report_beside() as draw:
        assert draw(run).startswith("not made: not a pcapng file")


def test_nothing_is_left_where_nothing_is_drawn() -> None:
    with report_beside():
        (drawer,) = children()
    assert owner(drawer) is None


def test_a_drawer_that_is_killed_ends_no_run(run: Path) -> None:
    with report_beside() as draw:
        (drawer,) = children()
        os.kill(drawer, signal.SIGKILL)
        assert draw(run) == f"not made, its process ended (-9): `qmn report {run}` makes it"


def test_it_ends_with_a_runner_that_is_killed() -> None:
    command = [sys.executable, "-c", RUNNER]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as runner:
        assert runner.stdout is not None
        drawer = owner(int(runner.stdout.readline()))
        assert drawer is not None
        assert drawer.alive
        runner.kill()
    deadline = time.monotonic() + DEADLINE_S
    while drawer.alive:
        assert time.monotonic() < deadline, f"it has not ended in {DEADLINE_S:g} s"
        time.sleep(0.01)
