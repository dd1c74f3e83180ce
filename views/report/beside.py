"""A process that loads what draws a report while the network goes, and draws it at the end.

    runner ---- folder of the run ---> loads matplotlib, waits, draws
           <--- file, or why none ----

Loading takes as long as drawing. A fork has loaded all else already. Where this process has more
than one thread, as notebooks have, it cannot fork, and draws itself.
"""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from qmn.timeouts import REPORT_TIMEOUT_S
from topologies.system.processes import signals
from topologies.system.processes.fork_server import follow_runner, threads
from views.report.report_file import report_of_run

Draw = Callable[[Path], str]


@contextmanager
def report_beside() -> Iterator[Draw]:
    """Begin to load; yield what makes the report of a run, and returns its file or why none is."""
    if threads() > 1:
        yield report_of_run
        return
    processes = get_context("fork")
    ours, theirs = processes.Pipe()
    drawer = processes.Process(target=_serve, args=(theirs, ours, os.getpid()), name="report")
    drawer.start()
    theirs.close()

    def draw(run: Path) -> str:
        try:
            ours.send(run)
            if not ours.poll(REPORT_TIMEOUT_S):
                return f"not made in {REPORT_TIMEOUT_S:g} s: `qmn report {run}` makes it"
            reply: str = ours.recv()
        except (EOFError, ConnectionError):
            drawer.join()
            return f"not made, its process ended ({drawer.exitcode}): `qmn report {run}` makes it"
        return reply

    try:
        yield draw
    finally:
        ours.close()  # it ends
        drawer.join(REPORT_TIMEOUT_S)
        drawer.kill()
        drawer.join()


def _serve(channel: Connection, runners: Connection, runner: int) -> None:
    """Load, wait for a run's folder, draw; the signals of a terminal are for the runner."""
    signals.reset()
    for number in signals.Signals.OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)
    follow_runner(runner)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # programs that wake go first
    runners.close()
    import_module("views.report.page")
    try:
        run = channel.recv()
    except EOFError:
        return  # nothing is to be drawn
    channel.send(report_of_run(run))
