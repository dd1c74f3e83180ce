"""A run that fills its processors, looked at by a page in turns with none, and its pairs a second.

It is one run: two of them differ by more than what a page takes from one.
"""

import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from page import browser, opened, processors_s
from playwright.sync_api import Browser, Page

from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded

ROOT = Path(__file__).resolve().parents[2]
QMN = str(ROOT / "bin" / "qmn")
DEADLINE_S = 60.0
POLL_S = 0.2
SETTLE_S = 4.0  # behind opening a page, which takes seconds of processor once, and behind closing


@dataclass(frozen=True)
class Turn:
    """Some seconds of the run."""

    pairs_per_s: float
    events_per_s: float
    browser: float  # processors that all processes of the browser took
    text: str  # by the page; nothing: there was none


@dataclass(frozen=True)
class Time:
    """The same, before the run has reported."""

    begin_s: float
    end_s: float
    browser: float
    text: str


def run(
    folder: Path, rounds: int, seconds: float, block_pairs: int, rate_hz: int | None = None
) -> tuple[Path, list[Turn]]:
    """Return the run's folder, and its turns: without a page, with one, without, …, without.

    Its source makes pairs at this rate (None: as fast as this machine can).
    """
    # Frames are as small as can be, so that there are as many events as can be.
    sent = ["--block-pairs", str(block_pairs), "--frame-bytes", "8", "--captures", "none"]
    sent += ["--rate-hz", str(rate_hz)] if rate_hz else []
    message = folder / "message"
    message.write_bytes(bytes(range(250)) * (1 << 16))  # of which a run sends a part
    command = [QMN, "run", "sdc", "--file", str(message), *sent, "--without", "report"]
    with (
        subprocess.Popen([*command, "--runs", str(folder)], stdout=subprocess.DEVNULL) as network,
        browser() as (chromium, devtools),
    ):
        times = []
        for number in range(2 * rounds + 1):
            with open_page(chromium, network) if number % 2 else nullcontext() as page:
                time.sleep(SETTLE_S)
                began, spent = time.time(), processors_s(devtools)
                time.sleep(seconds)
                took = (processors_s(devtools) - spent) / seconds
                text = page.inner_text("#status") if page is not None else ""
                times.append(Time(began, time.time(), took, text))
        assert network.poll() is None, "the run has ended before it was measured"
        network.send_signal(signal.SIGINT)
        network.wait(DEADLINE_S)
    latest = (folder / "latest").resolve()
    return latest, turns(latest, times)


@contextmanager
def open_page(chromium: Browser, network: "subprocess.Popen[bytes]") -> Iterator[Page]:
    """Serve a page of the network by `qmn live`, as from another terminal, and look at it."""
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline and network.poll() is None:
        view = subprocess.Popen([QMN, "live"], stdout=subprocess.PIPE, text=True)
        with view:
            assert view.stdout is not None
            try:
                if found := re.search(r"http\S+", view.stdout.readline()):
                    page = opened(chromium, found[0])
                    yield page
                    page.close()
                    return
            finally:
                view.terminate()
        time.sleep(POLL_S)
    raise AssertionError(f"no page within {DEADLINE_S:.0f} s")


def turns(run: Path, times: list[Time]) -> list[Turn]:
    """Return what a run did at these times."""
    pairs, events = [0] * len(times), [0] * len(times)
    for event in recorded(run / EVENT_CAPTURE, follow=False):
        for number, each in enumerate(times):
            if each.begin_s <= event.time_ns / 1e9 < each.end_s:
                events[number] += 1
                pairs[number] += event.photons if event.kind == "create" else 0
    took = [each.end_s - each.begin_s for each in times]
    return [
        Turn(made / s, happened / s, each.browser, each.text)
        for made, happened, s, each in zip(pairs, events, took, times, strict=True)
    ]
