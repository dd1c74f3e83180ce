"""A page of a live view in Chromium, and how far it is behind.

While it follows, the page's clock shows the time of the newest event that is drawn. Events come all
the time, so that what the system's clock is ahead of it is how far the page is behind.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import CDPSession, Page, ViewportSize, sync_playwright
from test_report_in_browser import installed_browser

CLOCKS_PER_S = 100  # of /proc: USER_HZ
LOOK_S = 1.0  # between two looks at memory
OPEN_MS = 30_000
VIEWPORT: ViewportSize = {"width": 1400, "height": 1000}
PROBE = """origin => {
  window.behind = []; window.drawings = []; // moments, in ms
  const clock = document.getElementById("clock");
  const changes = {childList: true, characterData: true, subtree: true};
  new MutationObserver(() => drawings.push(Date.now())).observe(clock, changes);
  (function look() {
    behind.push([Date.now(), Date.now() - origin - 1000 * parseFloat(clock.value)]);
    requestAnimationFrame(look);
  })();
}"""


@dataclass(frozen=True)
class Sample:
    """What was seen of a page."""

    behind_ms: list[float]  # at each frame
    frames_per_s: float  # in which something new was drawn
    heap_mib: float  # the most, of JavaScript
    memory_mib: float  # the most that the page's process had for itself alone
    page_cpu: float  # processors that the page's process took
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


def looked_at(
    address: str, seconds: float, server: int, over: Callable[[], bool] = lambda: False
) -> Sample:
    """Look at a page for some seconds, or until its network has ended or it is over."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=installed_browser(), args=["--no-sandbox"]
        )
        page = chromium.new_page(viewport=VIEWPORT, bypass_csp=True)  # to ask it things
        page.goto(address)
        page.wait_for_function(
            "document.querySelector('#status').textContent.startsWith('live') && "
            "parseFloat(document.getElementById('clock').value) > 0",
            timeout=OPEN_MS,
        )
        pid = renderer(chromium.new_browser_cdp_session())
        sample = sampled(page, pid, seconds, server, over)
        chromium.close()
    return sample


def sampled(page: Page, pid: int, seconds: float, server: int, over: Callable[[], bool]) -> Sample:
    """Look from now on."""
    heap = page.context.new_cdp_session(page)
    heap.send("Performance.enable")
    origin_ms = page.evaluate("async () => (await (await fetch('network.json')).json()).origin_ns")
    began, spent = time.monotonic(), (cpu_s(pid), cpu_s(server))
    page.evaluate(PROBE, int(origin_ms) / 1e6)
    heaps, memories = [0.0], [0.0]
    while (left := began + seconds - time.monotonic()) > 0:
        page.wait_for_timeout(1000 * min(left, LOOK_S))
        metrics = {
            each["name"]: each["value"] for each in heap.send("Performance.getMetrics")["metrics"]
        }
        heaps.append(metrics["JSHeapUsedSize"] / (1 << 20))
        memories.append(own_mib(pid))
        if over() or page.inner_text("#status").startswith("the network has ended"):
            break
    took = time.monotonic() - began
    page_s, server_s = cpu_s(pid) - spent[0], cpu_s(server) - spent[1]
    behind, drawings = page.evaluate("[behind, drawings]")
    # Behind the last event there is nothing that a page could be late with.
    late = [late_ms for moment, late_ms in behind if moment <= drawings[-1]]
    shown_s = (drawings[-1] - drawings[0]) / 1000
    memory = max(heaps), max(memories)
    return Sample(late, len(drawings) / shown_s, *memory, page_s / took, server_s / took)
