"""A browser on the live page of a network, and what hosts of it report."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from limits import SOON_S
from live_page import browser
from playwright.sync_api import Browser, Page, expect
from recorded_run import START_NS

from views.live.server import View

SESSION = "18f3be73bfbdb225"
DEADLINE_MS = 1000 * SOON_S


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as started:
        yield started


@pytest.fixture
def text() -> Iterator[list[str]]:
    """Errors of scripts, and words to the browser's console: there are none at the end."""
    heard: list[str] = []
    yield heard
    assert heard == []


def opened(chromium: Browser, url: str, text: list[str], **options: Any) -> Page:
    """Open the page."""
    page = chromium.new_page(**options)
    page.set_default_timeout(DEADLINE_MS)
    page.on("pageerror", lambda error: text.append(str(error)))
    page.on("console", lambda message: text.append(message.text))
    page.goto(url)
    return page


def tell(view: View, t: float, kind: str, node: str, **fields: Any) -> None:
    """Let something happen at a time, in seconds."""
    view.timeline.add("event", START_NS + round(t * 1e9), {"node": node, "kind": kind, **fields})


def light(view: View, t: float) -> None:
    """Open the path of the recorded network from alice to bob, and send light over it."""
    tell(view, t, "open", "q1", port="2", detail="2 -> 3")
    tell(view, t, "open", "q2", port="1", detail="1 -> 2")
    block = {"session": SESSION, "block": 1, "half": 0, "photons": 100}
    tell(view, t, "create", "alice", **block)
    tell(view, t, "send", "alice", port="alice-q0", **block)
    tell(view, t + 0.001, "arrive", "bob", port="bob-q0", lost=40, **block)
    tell(view, t + 0.002, "store", "bob", **block)


FIBER, SWITCH, HOST = re.compile("^fibre alice-q0"), "quantum switch q1", "host alice"
FRAME = {"setting": "frame-bytes"}
Press = tuple[str | re.Pattern[str], dict[str, str], str, str]
PRESSED: list[Press] = [  # what is chosen, what is typed, the button, the command
    (HOST, {}, "send", "send alice bob hello"),
    (HOST, FRAME | {"value": "64"}, "set", "set host alice frame-bytes 64"),
    (HOST, FRAME | {"value": "default"}, "set", "set host alice frame-bytes default"),
    (HOST, {}, "reload the policy", "set policy reload"),
    (FIBER, {}, "cut", "set link alice q1 down"),
    (FIBER, {}, "mend", "set link alice q1 up"),
    (FIBER, {"fraction measured": "0.5"}, "put eve on it", "set tap alice q1 0.5"),
    (FIBER, {}, "take eve off", "set tap alice q1 0"),
    (FIBER, {"mW": "2"}, "classical light", "set classical alice q1 2"),
    (FIBER, {}, "calibrate", "set calibrate alice q1"),
    (SWITCH, {"in port": "2", "out port": "3"}, "stuck", "set fault q1 stuck 2 3"),
    (SWITCH, {"°C": "80"}, "temperature", "set fault q1 temperature 80"),
    (SWITCH, {}, "repair", "set fault q1 repair"),
]
BOX = "document.getElementById('network').viewBox.baseVal"


def box(page: Page) -> list[float]:
    """Return which part of the drawing is seen: left, top, width, height."""
    text = page.locator("#network").get_attribute("viewBox")
    assert text is not None
    return [float(each) for each in text.split()]


def place(page: Page, name: str) -> tuple[float, float]:
    """Return where a node is on the screen."""
    found = page.get_by_role("button", name=name).bounding_box()
    assert found is not None
    return found["x"] + found["width"] / 2, found["y"] + found["height"] / 2


def overlaps(page: Page, selector: str) -> list[str]:
    """Return pairs of what is seen of these whose boxes on the screen overlap by over a pixel."""
    seen = [each for each in page.locator(selector).all() if each.is_visible()]
    boxes = [(each.text_content(), each.bounding_box()) for each in seen]
    found = []
    for number, (name, one) in enumerate(boxes):
        for other, two in boxes[:number]:
            assert one is not None
            assert two is not None
            across = max(one["x"] - two["x"] - two["width"], two["x"] - one["x"] - one["width"])
            down = max(one["y"] - two["y"] - two["height"], two["y"] - one["y"] - one["height"])
            if max(across, down) < -1:
                found.append(f"{name} {other}")
    return found


def press(
    page: Page, chosen: str | re.Pattern[str], typed: dict[str, str], button: str, command: str
) -> None:
    """Choose a thing, type into the fields of a button, press it, and wait until it is done."""
    page.get_by_role("button", name=chosen).first.press("Enter")
    at = page.locator("#chosen")
    form = at.locator("form").filter(has=page.get_by_role("button", name=button, exact=True))
    for label, text in typed.items():
        form.get_by_label(label).fill(text)
    form.get_by_role("button", name=button, exact=True).click()
    output = at.locator("p[role=status]")
    expect(output).to_contain_text(f"qmn {command}")
    expect(output).to_have_class("good")
    expect(output).to_be_in_viewport(ratio=0.9)
