"""The report as Chromium shows it: on a large screen and a phone, in the light and the dark."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from recorded_run import record_run

from views.report import charts
from views.report.light_paths import Hop, LightPath
from views.report.page import POLICY
from views.report.report_file import made_report

BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
PHONE = 390  # pixels
LIGHT, DARK = 1, 0  # of Chromium's preferredColorScheme
# A script that asks the page about itself; it stands behind the page, which has none of its own.
ASK = """<script>
const colour = element => getComputedStyle(element);
document.body.dataset.seen = JSON.stringify({
  width: window.innerWidth,
  overflow: document.documentElement.scrollWidth - window.innerWidth,
  paper: colour(document.body).backgroundColor,
  figures: [...document.querySelectorAll('figure')].map(figure => {
    const svg = figure.querySelector('svg');
    const box = svg.getBBox(), place = svg.getBoundingClientRect();
    const marks = [...svg.querySelectorAll('path')].filter(path => {
      const style = colour(path), size = path.getBBox();
      return !path.closest('defs') && size.width + size.height > 0
        && (style.fill !== 'none' || style.stroke !== 'none');
    });
    const texts = [...svg.querySelectorAll('text')];
    return {
      title: figure.querySelector('h2').textContent,
      width: place.width, height: place.height, drawn: box.width * box.height,
      marks: marks.length,
      colours: [...new Set(texts.map(text => colour(text).fill))],
      sizes: texts.map(text => text.getBoundingClientRect().height),
      cut: texts.filter(text => {
        const seen = text.getBoundingClientRect();
        return seen.left < place.left || seen.right > place.right
          || seen.top < place.top || seen.bottom > place.bottom;
      }).map(text => text.textContent),
    };
  }),
});
</script>"""


# A window of full Chromium is never narrower than 500 pixels: the page is in a frame.
FRAME = """<!doctype html><meta name="color-scheme" content="light dark">
<body style="margin: 0"><iframe style="border: 0; width: {width}px; height: 900px" srcdoc="{page}"
  onload="document.body.dataset.seen = this.contentDocument.body.dataset.seen"></iframe></body>"""


def installed_browser() -> str:
    """Return the path of a browser."""
    browsers = [path for name in BROWSERS if (path := shutil.which(name))]
    assert browsers, f"no browser ({', '.join(BROWSERS)}): setup/browser installs one"
    return browsers[0]


def browse(folder: Path, width: int, scheme: int, script: str = "") -> tuple[dict[str, Any], str]:
    """Return the page's text on itself, and the lines of the browser's console."""
    report = (folder / "report.html").read_text() + script + ASK
    # The page forbids scripts; all else that it forbids stays so, and would be a complaint.
    report = report.replace(POLICY, f"{POLICY}; script-src 'unsafe-inline'")
    page = folder / "asked.html"
    page.write_text(FRAME.format(width=width, page=html.escape(report)))
    command = [
        installed_browser(),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--enable-logging=stderr",
    ]
    command += [
        f"--window-size={max(width, 500)},900",
        f"--blink-settings=preferredColorScheme={scheme}",
    ]
    command += [f"--user-data-dir={folder / 'browser'}", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    (seen,) = re.findall(r'data-seen="([^"]*)"', done.stdout)
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return json.loads(html.unescape(seen)), "\n".join(console)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = record_run(tmp_path_factory.mktemp("run"))
    made_report(run)
    return run


def lightness(colour: str) -> float:
    red, green, blue = (int(number) for number in re.findall(r"\d+", colour)[:3])
    return (0.2126 * red + 0.7152 * green + 0.0722 * blue) / 255


@pytest.mark.parametrize("scheme", [LIGHT, DARK])
@pytest.mark.parametrize("width", [1200, PHONE])
def test_every_figure_shows_something_and_nothing_complains(
    folder: Path, width: int, scheme: int
) -> None:
    seen, console = browse(folder, width, scheme)
    assert console == ""
    assert len(seen["figures"]) == 7
    for figure in seen["figures"]:
        assert figure["width"] > 200, figure["title"]
        assert figure["height"] > 150, figure["title"]
        assert figure["drawn"] > 0, figure["title"]
        assert figure["marks"] >= 3, figure["title"]
        assert min(figure["sizes"]) >= 9, figure["title"]  # of a line, in pixels
        assert figure["cut"] == [], figure["title"]
        for colour in figure["colours"]:  # text stands out
            assert abs(lightness(colour) - lightness(seen["paper"])) > 0.35, figure["title"]
    assert (lightness(seen["paper"]) > 0.5) == (scheme == LIGHT)


def test_a_phone_shows_the_page_without_scrolling_sideways(folder: Path) -> None:
    seen, _console = browse(folder, PHONE, LIGHT)
    assert seen["width"] == PHONE
    assert seen["overflow"] <= 0
    # A figure that is too wide for it scrolls by itself.
    assert [figure["title"] for figure in seen["figures"] if figure["width"] > PHONE] == [
        "The network",
        "The handshake, in both layers",
    ]


def test_labels_have_room_however_long_their_numbers_are(tmp_path: Path) -> None:
    counts = [0, 987_654, 987_654_321]
    each = [10**9 * n for n in range(1, 4)]
    hops = (Hop("charlie-q0 - q1:2", 12.75, ("charlie", "q1")),)
    drawn = [
        charts.rate(0, each, counts, counts),
        charts.errors([0.0, 999.5, 1000.0], dict.fromkeys(("symbol errors", "lost"), counts)),
        charts.errors([0.0, 1e-4, 2e-4], {"symbol errors": counts, "lost": [0, 1, 2]}),
        charts.confusion(np.full((4, 4), 987_654), 4),
        charts.loss_budget([LightPath("charlie-q0", "q1:2", hops)], 30.0),
        charts.setup_times([0.125] * 9_999 + [12_345.5]),
    ]
    figures = "".join(f"<figure><h2>{n}</h2>{svg}</figure>" for n, svg in enumerate(drawn))
    (tmp_path / "report.html").write_text(f"<!DOCTYPE html><body>{figures}</body>")
    seen, _console = browse(tmp_path, 1200, LIGHT)
    assert [figure["cut"] for figure in seen["figures"]] == [[]] * len(drawn)


def test_a_complaint_would_be_noticed(folder: Path) -> None:
    _seen, console = browse(folder, 1200, LIGHT, "<script>console.error('look here')</script>")
    assert "look here" in console
