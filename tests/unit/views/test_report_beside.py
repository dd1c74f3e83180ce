"""A report that is drawn by a process beside the run."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from limits import SOON_S, wait_until
from recorded_run import record_run

from topologies.system.processes.owners import owner
from topologies.system.processes.programs import ROOT
from views.report.beside import report_beside
from views.report.report_file import made_report

# A runner that says which process draws its reports, and then what its input asks for.
RUNNER = """
import os, sys
from pathlib import Path
from views.report.beside import report_beside

def children():
    return Path("/proc/self/task", str(os.getpid()), "children").read_text().split()

with report_beside() as draw:
    print(*children(), flush=True)
    for line in sys.stdin:
        print(draw(Path(line.strip())), flush=True)
print(len(children()))
"""


class Runner:
    """Such a process; it has one thread, as those of tests may not have."""

    def __init__(self) -> None:
        pipe, command = subprocess.PIPE, [sys.executable, "-c", RUNNER]
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT)
        drawer = owner(int(self.line()))
        assert drawer is not None
        assert drawer.alive
        self.drawer = drawer

    def line(self) -> str:
        """Return what it says next."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def drawn(self, run: Path) -> str:
        """Have a report drawn; return its file, or why there is none."""
        assert self.process.stdin is not None
        print(run, file=self.process.stdin, flush=True)
        return self.line()

    def end(self) -> int:
        """Let it end; return how many children it has left behind."""
        left, _nothing = self.process.communicate(timeout=SOON_S)
        return int(left)


@pytest.fixture
def runner() -> Iterator[Runner]:
    made = Runner()
    with made.process:
        yield made
        made.process.kill()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return record_run(tmp_path)


def test_it_is_the_report_that_a_run_is_drawn_by_itself(runner: Runner, run: Path) -> None:
    assert runner.drawn(run) == str(run / "report.html")
    beside = (run / "report.html").read_text()
    program = f"from pathlib import Path; from {made_report.__module__} import made_report; "
    program += f"made_report(Path({str(run)!r}))"  # other tests may have set other styles here
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True, timeout=SOON_S)
    assert (run / "report.html").read_text() == beside
    assert runner.end() == 0


def test_why_there_is_none_comes_from_there(runner: Runner, run: Path) -> None:
    (run / "quantum.pcapng").write_bytes(b"this is not a capture")
    assert runner.drawn(run).startswith("not made: not a pcapng file")


def test_nothing_is_left_where_nothing_is_drawn(runner: Runner) -> None:
    assert runner.end() == 0
    assert not runner.drawer.alive


def test_a_drawer_that_is_killed_ends_no_run(runner: Runner, run: Path) -> None:
    runner.drawer.signal(signal.SIGKILL)
    text = runner.drawn(run)
    assert text == f"not made, its process ended (-9): `qmn report {run}` makes it"


def test_it_ends_with_a_runner_that_is_killed(runner: Runner) -> None:
    runner.process.kill()
    wait_until(lambda: not runner.drawer.alive, "it ends")


def test_a_process_of_several_threads_draws_itself(run: Path) -> None:
    waiting = threading.Event()
    thread = threading.Thread(target=waiting.wait)
    thread.start()
    try:
        before = children()
        with report_beside() as draw:
            assert children() == before
            assert draw(run) == str(run / "report.html")
    finally:
        waiting.set()
        thread.join()
    assert (run / "report.html").exists()


def children() -> str:
    return Path("/proc/self/task", str(os.getpid()), "children").read_text()
