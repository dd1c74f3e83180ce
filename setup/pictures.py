"""Draws what the documentation shows of reports and of the live page, as Chromium shows them.

`python setup/pictures.py [JOB ...]`, as root: docs/gallery/, the report and the live page of each
job in light, dark and on a phone; without a job also docs/report.png and docs/live-view.png. Some
ten minutes.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

ROOT = Path(__file__).parent.parent
GALLERY = ROOT / "docs/gallery"
BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
BB84 = "qkd --rate-hz 200000 --sifted-per-key 20000 --block-pairs 10000"
JOBS = {
    "sdc": "sdc --topology chain --length-km 1 --loss-db-per-km 0.2",
    "teleport": "teleport --topology chain,3 --depolarizing 0.01 --count 1000",
    "distribute": "distribute --count 1000 --length-km 10 --device *.source.fidelity=0.9",
    "swap": "swap --topology chain,4 --count 1000 --length-km 10 --device *.memory.t2_s=0.01",
    "qkd": f"{BB84} --seconds 5",
    "eve": f"{BB84} --seconds 5 --eve 0.2",
    "conference": "conference",
    "ghz": "ghz --count 1000",
    "graph": "graph --count 1000",
    "seal": "seal",
    "sense": "sense",
    "keys": "keys --seconds 30 --session-bits 10000 --high-mark 32",
    "vpn": "vpn",
    "load": "load --topology map,garr --sessions 20",
}
LOOKS = {"light": (1100, 1400), "dark": (1100, 1400), "phone": (420, 1400)}  # pixels
GAP, SHOWN_HEIGHT = 20, 900
SHARE = 0.7  # of a run's time: the moment that a live page shows


def run(words: str, runs: Path) -> Path:
    """Do a job; return the folder of its run."""
    command = [str(ROOT / "bin/qmn"), *words.split(), "--seed", "1", "--runs", str(runs)]
    subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    return (runs / "latest").resolve()


@contextmanager
def live_page(folder: Path) -> Iterator[str]:
    """Serve the live page of a run that is over; yield its address."""
    command = [str(ROOT / "bin/qmn"), "live", str(folder), "--no-browser"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = re.search(r"http://\S+", server.stdout.readline())
        assert address is not None
        try:
            yield address[0]
        finally:
            server.terminate()


def go_to_its_light(page: Page) -> None:
    """Go to a moment of the run."""
    expect(page.locator("#status")).to_have_text("a run that is over", timeout=120_000)
    slider, before = page.get_by_label("time in s"), ""
    while (end_s := slider.get_attribute("max") or "0") != before:
        before = end_s
        page.wait_for_timeout(2000)  # it has all of the run when its end stays
    slider.fill(str(SHARE * float(end_s)))
    page.wait_for_timeout(1000)
    page.mouse.click(5, 5)  # the slider is not what one shall look at


def shot(chromium: Browser, address: str, look: str, live: bool) -> Image.Image:
    width, height = LOOKS[look]
    page = chromium.new_page(
        viewport={"width": width, "height": height},
        color_scheme="dark" if look == "dark" else "light",
    )
    page.goto(address)
    if live:
        go_to_its_light(page)
    picture = Image.open(BytesIO(page.screenshot()))
    page.close()
    return picture


def beside(pictures: list[Image.Image], file: Path) -> None:
    """Write pictures beside each other, as one."""
    width = sum(each.width for each in pictures) + GAP * (len(pictures) - 1)
    whole = Image.new("RGB", (width, pictures[0].height), "#888")
    left = 0
    for each in pictures:
        whole.paste(each, (left, 0))
        left += each.width + GAP
    share = SHOWN_HEIGHT / whole.height
    whole.resize((round(share * width), SHOWN_HEIGHT)).save(file, quality=60, method=6)


def draw(name: str, runs: Path, chromium: Browser) -> None:
    """Run a job, and draw its report and its live page."""
    folder = run(f"run {JOBS[name]}", runs)
    report = (folder / "report.html").as_uri()
    beside([shot(chromium, report, look, False) for look in LOOKS], GALLERY / f"{name}-report.webp")
    with live_page(folder) as address:
        pictures = [shot(chromium, address, look, True) for look in LOOKS]
    beside(pictures, GALLERY / f"{name}-live.webp")


def main() -> None:
    """Draw what is asked for."""
    GALLERY.mkdir(exist_ok=True)
    names = sys.argv[1:]
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        executable = next(filter(None, map(which, BROWSERS)))
        chromium = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        runs = Path(folder)
        for name in names or JOBS:
            draw(name, runs, chromium)
        if not names:
            of_readme(runs, chromium)
        chromium.close()


def of_readme(runs: Path, chromium: Browser) -> None:
    """Draw the pictures that the README and the page of the live view show."""
    done = run(f"run {JOBS['sdc']}", runs)
    shot(chromium, (done / "report.html").as_uri(), "light", False).save(ROOT / "docs/report.png")
    text = runs / "message"
    text.write_bytes((ROOT / "README.md").read_bytes()[:3000])
    done = run(f"run {JOBS['sdc']} --rate-hz 20000 --file {text}", runs)
    with live_page(done) as address:
        shot(chromium, address, "light", True).save(ROOT / "docs/live-view.png")


if __name__ == "__main__":
    main()
