"""Every button of the live view, pressed in Chromium on the page of a network that runs."""

import json
import re
from pathlib import Path

import pytest
from limits import SOON_S
from live_page import browser
from live_view_scene import PRESSED, press
from loaded import running_qmn
from playwright.sync_api import expect
from test_live_page_of_a_network import ADDRESS, network_with_a_page

from views.live.acts import ACTS

DEADLINE_MS = 1000 * SOON_S
SEEN = {  # what the drawing shows behind a command: how many there are of what
    "set link alice q1 down": (".fiber.cut", 1),
    "set link alice q1 up": (".fiber.cut", 0),
    "set tap alice q1 0.5": (".fiber.tapped", 1),
    "set tap alice q1 0": (".fiber.tapped", 0),
    "set fault q1 stuck 2 3": (".node.faulty", 1),
    "set fault q1 repair": (".node.faulty", 0),
}


@pytest.mark.nightly
@pytest.mark.timeout(500)
def test_every_button_does_what_its_command_does(tmp_path: Path) -> None:
    with network_with_a_page(tmp_path) as url, browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(DEADLINE_MS)
        expect.set_options(timeout=DEADLINE_MS)
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(url)
        for chosen, typed, button, command in PRESSED:
            press(page, chosen, typed, button, command)
            selector, number = SEEN.get(command, ("body", 1))
            expect(page.locator(selector)).to_have_count(number)
        # Bob's measurement: no symbol of 20 was wrong.
        errors = page.locator("#sessions tbody tr").last.locator("td").last
        expect(errors).to_have_text(re.compile(r"^0\.00 \(0\.00 to \d+\.\d\d\)$"))
        page.get_by_role("button", name="draw again").click()
        expect(page.locator("#handshake svg")).to_contain_text("Setup SDC")
        expect(page.locator("#decisions")).to_contain_text("you qmn send alice bob hello")
        assert wrong == []
        page.close()
    noted = [json.loads(line) for line in (tmp_path / "latest" / ACTS).read_text().splitlines()]
    assert [" ".join(each["command"]) for each in noted] == [command for *_, command in PRESSED]
    assert {each["status"] for each in noted} == {0}


@pytest.mark.nightly
def test_the_page_of_an_attack_goes_from_its_first_network_to_its_second() -> None:
    words = ["lab", "attack", "replay", "--live"]
    with browser() as chromium, running_qmn(*words, end_s=DEADLINE_MS / 1000) as attack:
        url = next(filter(None, map(ADDRESS.search, attack.stdout)))[1]
        page = chromium.new_page()
        page.set_default_timeout(DEADLINE_MS)
        expect.set_options(timeout=DEADLINE_MS)
        page.goto(url)
        name, status = page.locator("h1"), page.locator("[role=status]").first
        expect(name).to_have_text("network 1: replay-announcements-off")
        expect(page.get_by_role("button", name="host charlie")).to_be_visible()
        expect(name).to_have_text("network 2: replay-announcements-on")
        expect(status).to_have_text("live: network 2; 1 before it has ended")
        expect(status).to_have_text("network 2 has ended, and its command")
        reports = [line.split()[1:4] for line in attack.stdout]
        page.close()
    assert reports == [["announcements", "off", "20"], ["announcements", "on", "0"]]
    assert attack.returncode == 0
