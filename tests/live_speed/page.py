"""A page of a live view in Chromium, and how far it is behind.

While it follows, the page's clock shows the time of the newest event that is drawn. Events come all
the time, so that what the system's clock is ahead of it is how far the page is behind.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from playwright.sync_api import Browser, CDPSession, Page, ViewportSize, sync_playwright
from test_report_in_browser import installed_browser

CLOCKS_PER_S = 100  # of /proc: USER_HZ
LOOK_S = 1.0  # between two looks at memory
OPEN_MS = 30_000
VIEWPORT: ViewportSize = {"width": 1400, "height": 1000}
FRAME_MS = 17  # until a picture that is drawn is on the screen
PROBE = """origin => {
  window.drawings = []; // moments, and of what time the newest event then is, in ms
  const clock = document.getElementById("clock");
  const changes = {childList: true, characterData: true, subtree: true};
  new MutationObserver(() => drawings.push([Date.now(), origin + 1000 * parseFloat(clock.value)]))
    .observe(clock, changes);
}"""


@dataclass(frozen=True)
class Sample:
    """Measurements of a page."""

    behind_ms: list[float]  # at each millisecond
    frames_per_s: float  # in which something new was drawn
    heap_mib: float  # the most, of JavaScript
    memory_mib: float  # the most that the page's process had for itself alone
    browser_cpu: float  # processors that all its processes took
    server_cpu: float


def percentile(values: list[float], share: float) -> float:
    """Return what this share of the values (%) does not exceed."""
    return sorted(values)[min(int(len(values) * share / 100), len(values) - 1)]


def own_mib(pid: int) -> float:
    """Return what a process has in memory that it shares with no other (MiB)."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    fields = {line.split(":")[0]: line.split()[1] for line in lines[1:]}
    return sum(int(fields[name]) for name in ("Private_Clean", "Private_Dirty")) / 1024


def cpu_s(pid: int) -> float:
    """Return the processor time of a process, its threads included."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / CLOCKS_PER_S


def renderer(browser: CDPSession) -> int:
    """Return the process that shows the page: of those of its kind, the one that has done most."""
    found = browser.send("SystemInfo.getProcessInfo")["processInfo"]
    return int(max((e["cpuTime"], e["id"]) for e in found if e["type"] == "renderer")[1])


def processors_s(browser: CDPSession) -> float:
    """Return the processor time of all processes of a browser."""
    found = browser.send("SystemInfo.getProcessInfo")["processInfo"]
    return sum(cpu_s(each["id"]) for each in found)


@contextmanager
def browser() -> Iterator[tuple[Browser, CDPSession]]:
    """Start Chromium, and have somebody to ask it."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=installed_browser(), args=["--no-sandbox"]
        )
        try:
            yield chromium, chromium.new_browser_cdp_session()
        finally:
            chromium.close()


def opened(chromium: Browser, address: str) -> Page:
    """Open a live view, and wait until it shows that something happens."""
    page = chromium.new_page(viewport=VIEWPORT, bypass_csp=True)  # to ask it things
    page.goto(address)
    page.wait_for_function(
        "document.querySelector('#status').textContent.startsWith('live') && "
        "parseFloat(document.getElementById('clock').value) > 0",
        timeout=OPEN_MS,
    )
    return page


def looked_at(address: str, seconds: float, server: int) -> Sample:
    """Look at a page for some seconds."""
    with browser() as (chromium, devtools):
        page = opened(chromium, address)
        pid = renderer(devtools)
        heap = page.context.new_cdp_session(page)
        heap.send("Performance.enable")
        asked = "async () => (await (await fetch('network.json')).json()).origin_ns"
        page.evaluate(PROBE, int(page.evaluate(asked)) / 1e6)
        began, spent = time.monotonic(), (processors_s(devtools), cpu_s(server))
        heaps, memories = [0.0], [0.0]
        while (left := began + seconds - time.monotonic()) > 0:
            page.wait_for_timeout(1000 * min(left, LOOK_S))
            report = heap.send("Performance.getMetrics")["metrics"]
            metrics = {each["name"]: each["value"] for each in report}
            heaps.append(metrics["JSHeapUsedSize"] / (1 << 20))
            memories.append(own_mib(pid))
        took = time.monotonic() - began
        browser_s, server_s = processors_s(devtools) - spent[0], cpu_s(server) - spent[1]
        drawings = page.evaluate("drawings")
    shown_s = (drawings[-1][0] - drawings[0][0]) / 1000
    memory = max(heaps), max(memories)
    shares = browser_s / took, server_s / took
    return Sample(behind(drawings), len(drawings) / shown_s, *memory, *shares)


def behind(drawings: list[tuple[float, float]]) -> list[float]:
    """Return, of each millisecond, how old the newest event is that is on the screen."""
    return [
        now - newest
        for (moment, newest), (next_one, _) in pairwise(drawings)
        for now in range(round(moment) + FRAME_MS, round(next_one) + FRAME_MS)
    ]
