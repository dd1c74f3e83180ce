"""The drawing of a live page: zoom, columns, maps, and a thousand hosts."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from live_page import live, served
from live_view_scene import BOX, SESSION, box, light, opened, overlaps, place, tell
from live_view_scene import chromium as chromium
from live_view_scene import text as text
from playwright.sync_api import Browser, expect
from recorded_run import NETWORK, START_NS

from views.live.layout import described
from wire.config import QuantumSwitch
from wire.parameters.fiber import Fiber, FiberEnd


def test_the_fidelity_of_a_short_run_is_that_of_its_program(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    """Of a standard error the interval of 95 % is 1.96 to either side."""
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        asked = {"event": "granted", "session": SESSION, "from": "alice", "to": "bob"}
        view.timeline.add("controller", START_NS + 10**9, {**asked, "service": "teleport"})
        done = {"event": "done", "fidelity": 0.962, "fidelity_error": 0.005}
        view.timeline.add("job", START_NS + 2 * 10**9, done)
        fidelity = page.locator("#sessions tbody td").nth(10)
        expect(fidelity).to_have_text("0.9620 (0.9522 to 0.9718)")
        page.close()


def test_light_from_a_source_in_a_switch_into_a_memory_of_another_is_drawn(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    switches = [replace(each, memories=2, sources=1) for each in NETWORK.switches]
    view.network = described(replace(NETWORK, switches=switches))
    with served(view) as url:
        page = opened(chromium, url, text)
        tell(view, 1.0, "open", "q1", port="62001", detail="62001 -> 3")
        tell(view, 1.0, "open", "q2", port="1", detail="1 -> 61002")
        block = {"session": SESSION, "block": 1, "half": 0, "photons": 100}
        tell(view, 1.0, "create", "q1-source1", **block)
        tell(view, 1.0, "send", "q1-source1", port="62001", **block)
        tell(view, 1.001, "arrive", "q2-memory2", port="61002", lost=40, **block)
        row = ["q1-source1 → q2-memory2", "q2", "100", "40.0", "stands"]
        expect(page.locator("#paths tbody td")).to_have_text(row)
        expect(page.locator(".fiber.lit")).to_have_count(1)
        expect(page.locator("#sessions tbody td").nth(2)).to_have_text("q1, q2")
        tell(view, 1.1, "close", "q1", port="62001", detail="62001 -> 3")
        expect(page.locator("#paths tbody td").last).to_have_text("closed")
        page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1600])
def test_it_fits_a_phone_and_a_screen(
    chromium: Browser, tmp_path: Path, text: list[str], width: int, scheme: Any
) -> None:
    view = live(tmp_path)
    light(view, 0.1)
    with served(view) as url:
        page = opened(
            chromium, url, text, viewport={"width": width, "height": 800}, color_scheme=scheme
        )
        expect(page.locator(".fiber.lit")).to_have_count(3)
        overflow = "document.documentElement.scrollWidth - window.innerWidth"
        assert page.evaluate(f"() => {overflow}") <= 0
        name = page.locator(".node text", has_text="alice").bounding_box()
        assert name is not None
        assert name["height"] >= 9  # px: it can be read (7 by the font of large screens)
        dark = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
        assert (dark == "rgb(255, 255, 255)") == (scheme == "light")
        page.close()


def test_everything_has_a_name_for_who_does_not_see_it(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with served(live(tmp_path)) as url:
        page = opened(chromium, url, text)
        page.get_by_role("button", name="quantum switch q1").click()
        nameless = page.evaluate(
            """() => [...document.querySelectorAll('button, input, select, [role=button]')]
            .filter(each => !(each.ariaLabel || each.textContent.trim() || each.labels?.length))
            .map(each => each.outerHTML)"""
        )
        assert nameless == []
        for _ in range(60):  # by the keyboard alone one comes to every node
            page.keyboard.press("Tab")
            label = page.evaluate("() => document.activeElement.ariaLabel ?? ''")
            if label == "host bob":
                break
        assert label == "host bob"
        page.close()


def test_the_drawing_is_zoomed_by_buttons_and_wheel_and_dragged(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with served(live(tmp_path)) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#status")).to_have_text("live")
        whole = box(page)
        page.get_by_role("button", name="zoom in").click()
        left, top, width, height = box(page)
        assert width == pytest.approx(whole[2] / 1.3)
        assert left + width / 2 == pytest.approx(whole[0] + whole[2] / 2)  # the middle stays
        assert top + height / 2 == pytest.approx(whole[1] + whole[3] / 2)
        page.get_by_role("button", name="zoom out").click()
        assert box(page) == pytest.approx(whole)
        x, y = place(page, "host alice")
        page.mouse.move(x, y)
        page.mouse.wheel(0, -100)
        page.wait_for_function(f"() => {BOX}.width < {whole[2]}")
        assert place(page, "host alice") == pytest.approx((x, y), abs=2)  # what is pointed at stays
        ground = page.locator("#network").bounding_box()
        assert ground is not None
        corner = ground["x"] + 3, ground["y"] + 3
        page.mouse.move(*corner)
        page.mouse.down()
        page.mouse.move(corner[0] + 60, corner[1] + 40, steps=4)
        page.mouse.up()
        page.mouse.move(*corner)  # no button is down any more
        assert place(page, "host alice") == pytest.approx((x + 60, y + 40), abs=2)
        page.get_by_role("button", name="whole network").click()
        assert box(page) == pytest.approx(whole)
        page.close()


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("width", [390, 1400])
def test_no_names_of_a_map_overlap_at_any_zoom(
    chromium: Browser, tmp_path: Path, text: list[str], width: int
) -> None:
    places = [
        (9.19, 45.46),
        (9.2, 45.47),
        (9.22, 45.5),
        (11.34, 44.49),
        (12.5, 41.9),
        (13.36, 38.1),
    ]
    names = [f"place{number}" for number in range(len(places))]
    hosts = {name: f"10.0.0.{number}" for number, name in enumerate(names, 1)}
    fibers = [Fiber(FiberEnd(name, f"{name}-q0"), FiberEnd(f"q{name}", "1")) for name in names]
    positions = {f"q{name}": place for name, place in zip(names, places, strict=True)}
    net = replace(NETWORK, addresses=hosts, source=names[0], fibers=fibers, positions=positions)
    net = replace(net, switches=[QuantumSwitch(name) for name in positions])
    net = replace(net, copper=[], copper_switches=[])
    with served(replace(live(tmp_path), network=described(net))) as url:
        page = opened(chromium, url, text, viewport={"width": width, "height": 900})
        expect(page.locator("#status")).to_have_text("live")
        expect(page.locator("#network")).to_have_class(re.compile("dots"))
        assert page.locator(".node.named").count() > 1
        assert overlaps(page, "#network .name") == []
        for _turn in range(60):
            if "dots" not in (page.locator("#network").get_attribute("class") or ""):
                break
            page.get_by_role("button", name="zoom in").click()
        assert overlaps(page, "#network rect.box") == []
        boxes = [each.bounding_box() for each in page.locator("#network rect.box").all()]
        assert {round(box["width"]) for box in boxes if box} <= {92, 93, 94}  # as large as before
        page.get_by_role("button", name="whole network").click()
        expect(page.locator("#network")).to_have_class(re.compile("dots"))
        page.close()


@pytest.mark.nightly
def test_columns_lie_on_a_phone_and_stand_on_a_screen(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with served(live(tmp_path)) as url:
        page = opened(chromium, url, text, viewport={"width": 1400, "height": 900})
        (_, alice), (_, bob) = (place(page, f"host {name}") for name in ("alice", "bob"))
        assert abs(alice - bob) > 40  # one below the other
        page.set_viewport_size({"width": 390, "height": 844})
        expect(page.locator("#network")).to_have_class("turned")  # and not far
        (_, alice), (_, bob) = (place(page, f"host {name}") for name in ("alice", "bob"))
        assert alice == pytest.approx(bob, abs=1)  # side by side
        page.close()


@pytest.mark.nightly
def test_a_network_of_a_thousand_hosts_is_drawn_and_can_be_read_from_near(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    switches = [QuantumSwitch(f"q{n}") for n in range(32)]
    fibers = [
        Fiber(FiberEnd(f"h{n}", f"h{n}-q0"), FiberEnd(f"q{n % 32}", str(n // 32 + 1)))
        for n in range(1024)
    ]
    hosts = {f"h{n}": f"10.0.{n // 250}.{n % 250}" for n in range(1024)}
    large = replace(NETWORK, addresses=hosts, source="h0", fibers=fibers, switches=switches)
    large = replace(large, copper=[], copper_switches=[])
    view = replace(live(tmp_path), network=described(large))
    with served(view) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#status")).to_have_text("live")
        assert page.locator(".node").count() == 1024 + 32
        assert page.locator(".fiber").count() == 1024
        x, y = place(page, "host h700")
        page.mouse.move(x, y)
        for _turn in range(40):
            page.mouse.wheel(0, -100)
        name = page.locator(".node text", has_text="h700")
        expect(name).to_be_visible()
        page.wait_for_function("() => !document.getElementById('network').matches('.far')")
        page.get_by_role("button", name="host h700").click()
        expect(page.locator("#chosen")).to_contain_text("h700")
        page.close()
