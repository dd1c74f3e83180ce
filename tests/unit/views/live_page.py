"""A served live view, and a browser that looks at it."""

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue

from limits import SOON_S
from playwright.sync_api import Browser, sync_playwright
from recorded_run import NETWORK, START_NS
from test_report_in_browser import installed_browser

from views.live.address import Place
from views.live.layout import described
from views.live.pace import Pace, Times
from views.live.server import View, serve
from views.live.timeline import Timeline

ANYWHERE = Place()


def unused() -> Times:
    """Return times of processors that have nothing to do, whatever this machine does."""
    return time.monotonic_ns(), time.monotonic_ns()


def live(folder: Path, acts: bool = True, most: int = 1000) -> View:
    """Return a view of a network that goes on, of which nothing is known yet."""
    timeline = Timeline(START_NS, most)
    drawings = {"handshake": lambda: "<p>drawn</p>", "photons": lambda: "<p>twenty</p>"}
    network = described(NETWORK)
    return View("a network", network, timeline, folder, True, acts, drawings, Pace(unused))


@contextmanager
def served(view: View, place: Place = ANYWHERE) -> Iterator[str]:
    """Serve a view in a thread; yield its address."""
    texts: Queue[str] = Queue()
    ready: Queue[tuple[asyncio.AbstractEventLoop, asyncio.Task[None]]] = Queue()

    async def main() -> None:
        task = asyncio.ensure_future(
            serve(view, place, lambda address, _for_all: texts.put(address))
        )
        ready.put((asyncio.get_running_loop(), task))
        await asyncio.wait([task])

    thread = threading.Thread(target=lambda: asyncio.run(main()))
    thread.start()
    loop, task = ready.get(timeout=SOON_S)
    try:
        yield texts.get(timeout=SOON_S)
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(SOON_S)
        assert not thread.is_alive()


@contextmanager
def browser() -> Iterator[Browser]:
    """Start Chromium."""
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=installed_browser(), args=["--no-sandbox"]
        )
        try:
            yield started
        finally:
            started.close()
