"""The events of a run that come again, at a steady rate, to the server of a live view."""

import asyncio
import json
import multiprocessing
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from live_page import unused

from qmn.timeouts import LIVE_PAUSE_MS
from views.live.address import Place
from views.live.layout import described
from views.live.pace import Pace
from views.live.server import View, serve
from views.live.sources import EVENT, timeline_of_run
from views.live.timeline import Timeline
from views.report.run_facts import read_result

EVENTS_OF_A_SESSION = 100
DEADLINE_S = 30.0


@contextmanager
def replayed(run: Path, events_per_s: int) -> Iterator[tuple[str, int]]:
    """Serve a view of it by a process of its own; yield the address, and the process."""
    processes = multiprocessing.get_context("spawn")
    here, there = processes.Pipe()
    server = processes.Process(target=served, args=(run, events_per_s, there), daemon=True)
    server.start()
    try:
        assert here.poll(DEADLINE_S), f"no page within {DEADLINE_S:.0f} s"
        assert server.pid is not None
        yield here.recv(), server.pid
    finally:
        server.terminate()
        server.join(DEADLINE_S)


def served(run: Path, events_per_s: int, report: Connection) -> None:
    """Serve the replay until this process is asked to end."""
    _result, network = read_result(run)
    messages = map(json.loads, timeline_of_run(run).after(0, 1 << 30)[0])
    past = [each for each in messages if each["what"] == EVENT]
    timeline = Timeline(time.time_ns())
    threading.Thread(target=come_again, args=(past, timeline, events_per_s), daemon=True).start()
    facts = described(network)
    view = View("again", facts, timeline, run, True, False, {"handshake": str}, Pace(unused))
    asyncio.run(serve(view, Place(), lambda address, _for_all: report.send(address)))


def come_again(past: list[dict[str, Any]], timeline: Timeline, events_per_s: int) -> None:
    """Add events, each of the time at which it is due, as the dispatcher gathers them.

    A session is a new one each time.
    """
    number, began = 0, time.time_ns()
    while True:
        due = (time.time_ns() - began) * events_per_s // 1_000_000_000
        happened = []
        for number in range(number, due):  # noqa: B020
            event = past[number % len(past)]
            fields = {name: value for name, value in event.items() if name not in ("t", "what")}
            if "session" in fields:
                fields["session"] = f"{number // EVENTS_OF_A_SESSION:016x}"
            happened.append((began + number * 1_000_000_000 // events_per_s, fields))
        timeline.add_all(EVENT, happened)
        number = max(number, due)
        time.sleep(LIVE_PAUSE_MS / 1000)
