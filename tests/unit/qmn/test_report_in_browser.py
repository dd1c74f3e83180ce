"""The report as Chromium shows it: on a large screen and a phone, in the light and the dark."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from recorded_run import record_run

from qmn.reports.report_file import made_report

BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
PHONE = 390  # pixels
LIGHT, DARK = 1, 0  # of Chromium's preferredColorScheme
DEADLINE_S = 60
# What the page says of itself; it is put in behind the page, which has no script of its own.
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
    assert browsers, f"none of {', '.join(BROWSERS)} is there: setup/browser installs one"
    return browsers[0]


def browse(folder: Path, width: int, scheme: int, script: str = "") -> tuple[dict[str, Any], str]:
    """Return what the page says of itself, and what the browser's console said."""
    report = (folder / "report.html").read_text() + script + ASK
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
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=DEADLINE_S)
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
        for colour in figure["colours"]:  # text stands out
            assert abs(lightness(colour) - lightness(seen["paper"])) > 0.35, figure["title"]
    assert (lightness(seen["paper"]) > 0.5) == (scheme == LIGHT)


def test_a_phone_shows_the_page_without_scrolling_sideways(folder: Path) -> None:
    seen, _console = browse(folder, PHONE, LIGHT)
    assert seen["width"] == PHONE
    assert seen["overflow"] <= 0
    # What is too wide for it scrolls by itself.
    assert [figure["title"] for figure in seen["figures"] if figure["width"] > PHONE] == [
        "The network",
        "The handshake, in both layers",
    ]


def test_a_complaint_would_be_noticed(folder: Path) -> None:
    _seen, console = browse(folder, 1200, LIGHT, "<script>console.error('look here')</script>")
    assert "look here" in console
