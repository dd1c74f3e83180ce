"""Acts on a live page: each button runs its command, which is noted."""

import json
import re
import sys
from pathlib import Path

import pytest
from live_page import live, served
from live_view_scene import DEADLINE_MS, PRESSED, opened, press
from live_view_scene import chromium as chromium
from live_view_scene import text as text
from playwright.sync_api import Browser, expect

from views.live import acts

expect.set_options(timeout=DEADLINE_MS)


def test_every_button_runs_its_command(
    chromium: Browser, tmp_path: Path, text: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its words alone are printed here; by night they are done to a network."""
    monkeypatch.setattr(acts, "QMN", ("echo", "done:"))
    with served(live(tmp_path)) as url:
        page = opened(chromium, url, text)
        for each in PRESSED:
            press(page, *each)
            expect(page.locator("#chosen p[role=status]")).to_contain_text(f"done: {each[-1]}")
        page.close()
    noted = [json.loads(line) for line in (tmp_path / acts.ACTS).read_text().splitlines()]
    assert [" ".join(each["command"]) for each in noted] == [each[-1] for each in PRESSED]


# `qmn` as if networks had their files elsewhere: this machine may run some. No root is asked for.
QMN_ELSEWHERE = """import sys
from pathlib import Path
from topologies.system import namespaces
from topologies.system.runs import runtime
runtime.RUNTIME_ROOT = namespaces.RUNTIME_ROOT = Path({folder!r})
from qmn import __main__
__main__.become_root = lambda words: None
sys.exit(__main__.main())
"""


def test_an_act_shows_its_command_and_what_came_of_it(
    chromium: Browser, tmp_path: Path, text: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    code = QMN_ELSEWHERE.format(folder=str(tmp_path / "run"))
    monkeypatch.setattr(acts, "QMN", (sys.executable, "-c", code))
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        fiber = page.get_by_role("button", name=re.compile("^fibre alice-q0"))
        fiber.focus()
        page.keyboard.press("Enter")
        page.get_by_role("button", name="cut").click()
        answer = page.locator("#chosen .failed")  # no network runs here
        expect(answer).to_contain_text("qmn set link alice q1 down")
        expect(answer).to_contain_text("qmn: no network")
        decided = page.locator("#decisions li").first
        expect(decided).to_contain_text("you qmn set link alice q1 down")
        page.close()
    command = '"command": ["set", "link", "alice", "q1", "down"]'
    assert command in (tmp_path / "acts.jsonl").read_text()


def test_nothing_can_be_done_in_a_view_to_be_looked_at(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with served(live(tmp_path, acts=False)) as url:
        page = opened(chromium, url, text)
        page.get_by_role("button", name="host alice").click()
        expect(page.locator("#chosen")).to_contain_text("This page is read-only")
        expect(page.locator("#chosen form")).to_have_count(0)
        page.close()
