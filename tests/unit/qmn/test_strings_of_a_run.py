"""The strings of another person's run: no page and no terminal takes them for commands."""

import json
import re
import shutil
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from forked_python import run as run_python
from limits import SOON_S
from recorded_run import NETWORK, events, record_run

from dispatcher.layer.history import EventCapture
from qmn.printable_text import printable
from views.live.handshakes import drawn_handshake, newest_photons
from views.live.layout import described
from views.report.run_facts import read_result
from wire.dispatcher_pb2 import Event

# Markup, a terminal's title, NUL, mathematics of matplotlib, markup of rich.
HOSTILE = '<i/onload="a">&\'\x1b]0;owned\x07\x9b2J\x00$\\frac$[/x]'
IN_A_NAME = HOSTILE.replace("/", " ").replace("\0", "")  # of a file
# Strings by which a result is read; any other can be of any text.
CHOSEN = ("service", "controller", "backend", "mode")


def spoiled(given: Any, field: str = "") -> Any:
    """Return decoded JSON with all strings spoiled, names of nodes and ports everywhere alike."""
    if isinstance(given, dict):
        free = field in ("addresses", "positions", "datapath_ids", "devices", "emulation")
        return {key + HOSTILE * free: spoiled(each, key) for key, each in given.items()}
    if isinstance(given, list):
        return [spoiled(each, field) for each in given]
    return given + HOSTILE if isinstance(given, str) and field not in CHOSEN else given


def spoiled_events() -> Iterator[Event]:
    """Yield the events of the run likewise: ports of switches are numbers within a detail."""
    for event in events():
        event.node += HOSTILE
        if event.kind in ("open", "close"):
            event.detail = event.detail.replace(" -> ", f"{HOSTILE} -> ") + HOSTILE
            event.port += HOSTILE
        else:
            event.port, event.detail = event.port + HOSTILE, event.detail + HOSTILE
        yield event


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs, with a run whose strings are all hostile, and one that is not."""
    folder = tmp_path_factory.mktemp("foreign") / "runs"
    for name in ("20260101T100000-good", f"20260102T100000-{IN_A_NAME}"):
        (folder / name).mkdir(parents=True)
        record_run(folder / name)
    run = folder / name
    result = json.loads((run / "result.json").read_text())
    (run / "result.json").write_text(json.dumps(spoiled({**result, "error": "why"})))
    for file in (run / "controller.jsonl", run / "asking.log"):
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        reports = [{**line, "detail": HOSTILE} for line in lines if line["event"] == "path_ready"]
        file.write_text("".join(f"{json.dumps(line)}\n" for line in reports or lines))
    with (run / "quantum.pcapng").open("wb") as opened:
        EventCapture(opened, NETWORK.fibers).record(*spoiled_events())
    (run / "quantum.log").write_text(f"{HOSTILE}\n")
    (run / f"{IN_A_NAME}.keys").symlink_to("nowhere")  # is left out of a copy
    broken = folder / f"20260103T100000-{IN_A_NAME}"
    broken.mkdir()
    (broken / "result.json").write_text("{")
    return folder


def hostile(runs: Path) -> Path:
    return next(runs.glob("20260102*"))


@pytest.mark.parametrize(
    "words",
    [
        ["runs"],
        ["runs", "--json"],
        ["runs", "compare", "20260101", "20260102"],
        ["runs", "prune", "--older-than", "1h", "--dry-run"],
        ["runs", "export", "20260102", "run.zip"],
        ["runs", "export", "20260102", "copy"],
        ["report", "2026"],  # of three runs, whose names are in the error
        ["report", "20260103"],
        ["spy", "20260102"],
        ["spy", "20260102", "--json"],
        ["replay", "20260102"],
        ["wireshark", "20260102"],
        ["live", "20260103"],
    ],
    ids=" ".join,
)
def test_no_control_character_reaches_the_terminal(
    runs: Path, tmp_path: Path, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("QMN_CACHE", str(tmp_path / "cache"))
    shutil.copytree(runs, tmp_path / "runs", symlinks=True)
    command = [sys.executable, "-m", "qmn", *words]
    done = run_python(command, SOON_S, cwd=tmp_path)
    assert "Traceback" not in done.stderr
    assert "onload" in done.stdout + done.stderr
    assert printable(done.stdout) == done.stdout
    assert printable(done.stderr) == done.stderr


class Tags(HTMLParser):
    """The parts of a page: its tags and their attributes."""

    def __init__(self, page: str) -> None:
        """Read it."""
        super().__init__()
        self.found: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag."""
        self.found |= {tag, *(f"{tag} {name}" for name, _value in attrs)}


def test_no_string_is_markup_of_the_report(runs: Path) -> None:
    pages = {}
    for run in sorted(runs.glob("2026010[12]*")):
        done = run_python([sys.executable, "-m", "qmn", "report", str(run)], SOON_S)
        assert done.returncode == 0, done.stderr
        assert printable(done.stdout + done.stderr) == done.stdout + done.stderr
        pages[run.name[:8]] = (run / "report.html").read_text()
    good, page = pages.values()
    assert Tags(page).found - Tags(good).found <= {"p"}  # of its error
    assert printable(page) == page
    assert page.count("&lt;i/onload") > 20
    assert "<script" not in page
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy
    assert "script-src" not in policy


def test_no_string_is_markup_of_the_live_page(runs: Path) -> None:
    """The page gets JSON, of which it makes text; its elements that are HTML are drawings."""
    run = hostile(runs)
    _result, network = read_result(run)
    assert HOSTILE in json.loads(json.dumps(described(network)))["nodes"][0]["name"]
    assert "i onload" not in Tags(drawn_handshake(run, network)).found
    assert "i onload" not in Tags(newest_photons(run)).found
    page = Path(str(sys.modules[described.__module__].__file__)).with_name("page")
    html = [file.name for file in page.glob("*.js") if "innerHTML" in file.read_text()]
    assert html == ["handshake.js"]
