"""A page of a command that runs several networks, and pages whose server dies."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from limits import SOON_S
from live_page import live, served
from live_view_scene import DEADLINE_MS, light, opened
from live_view_scene import chromium as chromium
from live_view_scene import text as text
from playwright.sync_api import Browser, expect

from views.live import acts
from views.live.address import Place
from views.live.pages import Pages, kept_of_machine
from views.live.server import View

SERVER = """import asyncio, sys
from pathlib import Path
from live_page import ANYWHERE, live
from views.live.server import serve
asyncio.run(serve(live(Path(sys.argv[1])), ANYWHERE, lambda url, _for_all: print(url, flush=True)))
"""


def test_a_server_that_dies_is_told(chromium: Browser, tmp_path: Path) -> None:
    command = [sys.executable, "-c", SERVER, str(tmp_path)]
    path = os.pathsep.join(each for each in sys.path if each)
    environment = {**os.environ, "PYTHONPATH": path}
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server,
        closing(chromium.new_page()) as page,
    ):
        try:
            assert server.stdout is not None
            page.goto(server.stdout.readline().strip())
            expect(page.locator("#status")).to_have_text("live")
        finally:
            server.kill()
        expect(page.locator("#status")).to_have_text("no connection: has the network ended?")


@contextmanager
def served_in(pages: Pages, tmp_path: Path, name: str) -> Iterator[View]:
    """Serve the page of one network of a command, as `live_view` has it done."""
    view = replace(live(tmp_path), name=name)
    with pages.one_more(name) as number:
        place = Place(pages.port, Path(pages.socket(number)), pages.secret, number)
        with served(view, place):
            yield view


@contextmanager
def address_of_command(folder: Path) -> Iterator[tuple[Pages, str]]:
    """Serve the address of a command of several networks; yield where they are kept, and it."""
    folder.mkdir()
    program = [sys.executable, "-m", "views.live.command_page", str(folder)]
    root = Path(acts.__file__).parents[2]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, cwd=root) as server:
        assert server.stdout is not None
        try:
            yield Pages(folder), server.stdout.readline().strip().partition(": ")[2]
        finally:
            server.terminate()
    assert not folder.exists()


def test_the_page_of_a_command_goes_from_network_to_network(
    chromium: Browser, tmp_path: Path
) -> None:
    with address_of_command(tmp_path / "pages") as (pages, url):
        page = chromium.new_page()
        page.set_default_timeout(DEADLINE_MS)
        page.goto(url)
        status, name, networks = map(page.locator, ("[role=status]", "h1", "#networks option"))
        expect(status).to_contain_text("No network runs yet.")
        with served_in(pages, tmp_path, "first") as view:
            expect(name).to_have_text("network 1: first")
            expect(status.first).to_have_text("live: network 1")
            light(view, 1.0)
            expect(page.locator("#memories tbody tr")).to_have_count(1)
        expect(status.first).to_have_text("network 1 has ended, the next one has not started yet")
        expect(page.locator("#memories tbody tr")).to_have_count(1)  # it can still be looked at
        with served_in(pages, tmp_path, "second"):
            expect(name).to_have_text("network 2: second")
            expect(status.first).to_have_text("live: network 2; 1 before it has ended")
            expect(page.locator("#memories")).to_have_text("No qubit is in a memory.")
            with served_in(pages, tmp_path, "third"):
                expect(networks).to_have_text(["2: second", "3: third"])
                expect(name).to_have_text("network 2: second")  # which goes on
                page.get_by_label("networks").select_option("3")
                expect(name).to_have_text("network 3: third")
                page.get_by_role("button", name="pause").click()
            text = "network 3 has ended, and network 2 runs: see latest"
            expect(status.first).to_have_text(text)
            page.get_by_role("button", name="latest").click()
            expect(name).to_have_text("network 2: second")
        page.reload()  # of a network that is over, when none runs
        expect(status).to_contain_text("Network 3, third, has ended.")
        with served_in(pages, tmp_path, "fourth"):
            expect(name).to_have_text("network 4: fourth")
        expect(status.first).to_contain_text("network 4 has ended")
    expect(status.first).to_have_text("network 4 has ended, and its command")
    page.close()


def test_a_page_that_waits_for_a_network_hears_that_its_command_has_ended(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with address_of_command(tmp_path / "pages") as (_pages, url):
        page = opened(chromium, url, text)
        status = page.locator("[role=status]")
        expect(status).to_contain_text("No network runs yet.")
        with page.expect_request(re.compile(r"/networks\?next$")):
            page.reload()
        # That question may only be on its way; a browser's next one comes after it.
        assert page.evaluate("async () => (await fetch('networks')).status") == 200
    expect(status).to_have_text("No network runs yet. So has its command.")
    page.close()


def test_a_network_waits_for_a_page_that_is_being_opened(
    chromium: Browser, tmp_path: Path, text: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One can be over before its page has asked for what happened in it, here as late as it may."""
    monkeypatch.setattr("views.live.server.LIVE_LAST_S", SOON_S)
    view = live(tmp_path)
    light(view, 1.0)
    with served(view) as url:
        page = chromium.new_page()
        page.on("pageerror", lambda error: text.append(str(error)))
        page.goto(url, wait_until="commit")  # its address has been answered, and nothing else
    expect(page.locator("#status")).to_have_text("the network has ended")
    expect(page.locator("#memories tbody tr")).to_have_count(1)
    page.close()


def test_one_shows_the_networks_of_a_machine_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("views.live.pages.MACHINE_PAGES", tmp_path / "pages")
    assert Pages.of_machine() is None
    with kept_of_machine() as pages:
        assert Pages.of_machine() == pages
        (pages.folder / "1").mkdir()
        with pytest.raises(OSError, match="another `qmn live --all`"), kept_of_machine():
            pass
    assert Pages.of_machine() is None  # as if it had been killed: the folder is left
    with kept_of_machine() as pages:
        assert list(pages.folder.glob("[0-9]*")) == []
