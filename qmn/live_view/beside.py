"""A live view beside a network that this process has started: a program of its own."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from selectors import EVENT_READ, DefaultSelector

from qmn.timeouts import LIVE_END_S, LIVE_START_S
from topologies.programs import NetworkError


@contextmanager
def live_view(wanted: bool, say: Callable[[str], None]) -> Iterator[None]:
    """Serve the page of the network that runs, and say where, as long as this lasts.

    Raise NetworkError if it does not begin in time.
    """
    if not wanted:
        yield
        return
    command = [sys.executable, "-m", "qmn", "live"]
    # A session of its own: Ctrl-C is for the network, and its end ends the page.
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as server:
        try:
            say(_first_line(server))
            yield
        finally:
            server.terminate()
            try:
                server.wait(LIVE_END_S)
            except subprocess.TimeoutExpired:
                server.kill()


def _first_line(server: "subprocess.Popen[bytes]") -> str:
    assert server.stdout is not None
    with DefaultSelector() as selector:
        selector.register(server.stdout, EVENT_READ)
        ready = selector.select(LIVE_START_S)
    line = os.read(server.stdout.fileno(), 4096) if ready else b""
    if not line:
        raise NetworkError(f"--live: the page has not begun in {LIVE_START_S:g} s: try `qmn live`")
    return line.decode().strip()
