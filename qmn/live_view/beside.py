"""A live view beside a network that this process has started: a program of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from qmn.timeouts import LIVE_START_S
from topologies.system.processes.programs import Program, python

SAID = "live view"


@contextmanager
def live_view(wanted: bool, folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Serve the page of the network that runs, and say where, as long as this lasts.

    Its log is in the folder of the run. Raise NetworkError if it does not begin in time.
    """
    if not wanted:
        yield
        return
    server = Program("live", folder / "live.log")
    server.start([python(), "-m", "qmn", "live"])
    try:
        server.wait_for(SAID, LIVE_START_S)
        say(next(line for line in server.said().splitlines() if line.startswith(SAID)))
        yield
    finally:
        server.stop()
