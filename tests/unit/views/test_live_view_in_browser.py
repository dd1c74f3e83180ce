"""The live view as Chromium shows it: large and small, by mouse and keyboard, to its end."""

import re
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from live_page import live, served
from live_view_scene import DEADLINE_MS, SESSION, light, opened, tell
from live_view_scene import chromium as chromium
from live_view_scene import text as text
from playwright.sync_api import Browser, expect
from recorded_run import START_NS, record_run

from views.key_links import KeyLink
from views.live import pace
from views.live.layout import described
from views.live.server import View
from views.live.sources import timeline_of_run
from views.report.run_facts import read_result

expect.set_options(timeout=DEADLINE_MS)


def test_a_finished_run_is_shown_at_any_time(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    folder = record_run(tmp_path)
    network = described(read_result(folder)[1])
    view = View("over", network, timeline_of_run(folder), folder, False, False, {"handshake": str})
    with served(view) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#status")).to_have_text("a run that is over")
        expect(page.locator("#sessions tbody tr")).to_have_count(1)
        cells = page.locator("#sessions tbody td")
        expect(cells.nth(5)).to_have_text("100")  # pairs
        expect(cells.nth(7)).to_have_text("60")  # photons that arrived
        expect(cells.nth(8)).to_have_text("40.0")  # % lost
        expect(page.locator("#outcomes")).to_contain_text("Φ+")
        expect(page.locator("#job")).to_contain_text("bell pairs")
        expect(page.locator(".fiber.lit")).to_have_count(0)  # at its end the path is closed
        page.get_by_label("time in s").fill("0.0025")
        expect(page.locator(".fiber.lit")).to_have_count(3)
        expect(page.locator("#outcomes")).to_have_text("No Bell measurement yet.")
        page.get_by_label("time in s").fill("0.0")  # with the set-up, its first act
        page.get_by_role("button", name="play").click()
        expect(page.locator("#outcomes")).to_contain_text("Φ+")
        expect(page.get_by_role("button", name="play")).to_be_visible()
        page.get_by_role("button", name="host alice").click()
        expect(page.locator("#chosen")).to_contain_text("nothing can be done to it")
        page.close()


def test_what_happens_is_shown_as_it_happens(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page, second = (opened(chromium, url, text) for _tab in range(2))
        expect(page.locator("#status")).to_have_text("live")
        light(view, 1.0)
        for each in (page, second):  # two tabs
            expect(each.locator(".fiber.lit")).to_have_count(3)
            expect(each.locator("#memories tbody tr")).to_have_count(1)
        second.reload()
        expect(second.locator(".fiber.lit")).to_have_count(3)
        facts = {"event": "refused", "session": SESSION, "detail": "BUSY"}
        view.timeline.add("controller", START_NS + 2 * 10**9, facts)
        expect(page.locator("#sessions")).to_contain_text("refused: BUSY")
        expect(page.locator("#decisions li").first).to_contain_text("2.000 s c0 refused")
        page.get_by_label("time in s").fill("1.1")  # for half a second photons flow
        expect(page.locator(".fiber.lit.flowing")).to_have_count(3)
        page.get_by_label("time in s").fill("0.5")
        expect(page.locator("#status")).to_have_text("live, looking back")
        expect(page.locator(".fiber.lit")).to_have_count(0)
        page.get_by_role("button", name="latest").click()
        expect(page.locator(".fiber.lit")).to_have_count(3)
        view.timeline.end()
        expect(page.locator("#status")).to_have_text("the network has ended")
        page.close()
        second.close()


def test_the_fill_of_key_stores_is_shown(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#keys")).to_have_text("No key links.")
        link = KeyLink("alice", "bob", 1200, 1199, 9596, 4096, 0.0123, "active")
        reports = {"devices": [], "sessions": [], "key_links": [asdict(link)]}
        view.timeline.add("devices", START_NS + 10**9, reports)
        row = ["alice → bob", "1,200", "1,199", "25", "4,096", "1.23", "active", "9,596"]
        expect(page.locator("#keys tbody td")).to_have_text(row)
        later = {"event": "key_link", **asdict(replace(link, keys_ready=2000))}  # in the record
        view.timeline.add("controller", START_NS + 2 * 10**9, later)
        row[1], row[3] = "2,000", "33"  # both counts, of what the store can hold
        expect(page.locator("#keys tbody td")).to_have_text(row)
        page.get_by_label("time in s").fill("1.5")
        expect(page.locator("#keys tbody td").nth(1)).to_have_text("1,200")
        page.close()


def told_by_hosts(view: View, t: float, **estimate: Any) -> None:
    """Let the controller record what an end of the session has found out."""
    fact = {"event": "estimate", "session": SESSION, "host": "bob", **estimate}
    view.timeline.add("controller", START_NS + round(t * 1e9), fact)


def test_what_is_known_of_a_sessions_pairs_is_in_its_row(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        light(view, 1.0)
        heads = page.locator("#sessions th")
        expect(heads.nth(10)).to_have_text("fidelity, or S of CHSH (95 %)")
        expect(heads.nth(11)).to_have_text("errors in % (95 %)")
        fidelity, errors = (page.locator("#sessions tbody td").nth(n) for n in (10, 11))
        expect(fidelity).to_have_text("not yet known")
        expect(errors).to_have_text("not yet known")
        told_by_hosts(view, 1.1, quantity="error_rate", value=0.03125, low=0.02, high=0.045)
        expect(errors).to_have_text("3.13 (2.00 to 4.50)")
        expect(fidelity).to_have_text("not yet known")
        told_by_hosts(view, 1.2, quantity="fidelity", value=0.9512, low=0.94, high=0.962)
        expect(fidelity).to_have_text("0.9512 (0.9400 to 0.9620)")
        told_by_hosts(view, 1.3, quantity="qber", value=0.0123, low=0.01, high=0.015)
        told_by_hosts(view, 1.3, quantity="chsh", value=2.71, low=2.6, high=2.82)
        expect(errors).to_have_text("QBER 1.23 (1.00 to 1.50); 3.13 (2.00 to 4.50)")
        expect(fidelity).to_have_text("0.9512 (0.9400 to 0.9620); S 2.710 (2.600 to 2.820)")
        expect(page.locator("#decisions li")).to_have_count(0)  # it is no decision
        page.get_by_label("time in s").fill("1.15")  # what was known then
        expect(fidelity).to_have_text("not yet known")
        over = {"event": "torn_down", "session": SESSION, "detail": "FIN"}
        view.timeline.add("controller", START_NS + 2 * 10**9, {**over, "session": "f" * 16})
        page.get_by_role("button", name="latest").click()
        expect(page.locator("#sessions tbody tr").first).to_contain_text("not measured")
        page.close()


def test_a_key_session_shows_its_error_rate_its_limit_and_eve(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    """Eve, who resends all light, knows half of the bits and spoils a quarter (BB84)."""
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        shown = page.locator("#qkd")
        expect(page.locator("#status")).to_have_text("live")
        expect(shown).to_be_hidden()
        asked = {"session": SESSION, "service": "bb84", "from": "alice", "to": "bob"}
        view.timeline.add("controller", START_NS, {"event": "granted", **asked})
        figures: dict[str, Any] = {
            "photons": 400,
            "raw_bits": 400,
            "sifted_bits": 200,
            "key_bits": 0,
            "keys": 0,
        }
        figures |= {"qber": None, "qber_low": None, "qber_high": None, "max_qber": 0.1}
        view.timeline.add("job", START_NS + 10**9, {"event": "result", **figures})
        expect(shown).to_contain_text("the error rate is known when test bits are compared")
        for number, share in enumerate((0.02, 0.04)):
            keys = {"key_bits": 100 * number, "newest_qber": [share, 0.01, 0.06]}
            keys |= {"qber": 0.03, "qber_low": 0.021, "qber_high": 0.043}
            view.timeline.add("job", START_NS + (2 + number) * 10**9, {**figures, **keys})
        expect(shown).to_contain_text("100 bits of secret key so far, QBER 3.0 % (2.1 to 4.3 %)")
        expect(shown.locator(".curves canvas")).to_have_count(2)
        detail = "Z=51 X=49: 0=48 1=52"
        for number in (0, 1):
            block = {"session": SESSION, "block": number, "half": 0, "photons": 100}
            tell(view, 4.0, "create", "alice", **block)
            tell(view, 4.0, "arrive", "charlie", **block)
            tell(view, 4.0, "resend", "charlie", **block, detail=detail)
            tell(view, 4.0, "arrive", "bob", **block, lost=40)
        expect(shown.locator(".eve")).to_have_text(
            "charlie has measured 200 of 200 photons (100.0 %) and sent on the outcomes. "
            "She so knows 50.0 % of the sifted bits, and makes 25.0 % of them wrong."
        )
        expect(page.locator(".node.eve")).to_have_count(1)
        cells = page.locator("#sessions tbody tr").first.locator("td")
        expect(cells.nth(7)).to_have_text("120")  # photons arrived, of 200: each of them once
        expect(cells.nth(8)).to_have_text("40.0")  # lost (%)
        expect(shown.locator("#photons")).to_have_text("twenty")
        noisy = {"qber": 0.26923, "qber_low": 0.2135, "qber_high": 0.3333}
        view.timeline.add("job", START_NS + 5 * 10**9, {**figures, **noisy})
        failed = {"event": "failed", "reason": "TOO_NOISY", "text": "no key: 56 of 208 bits"}
        view.timeline.add("job", START_NS + 5 * 10**9, failed)
        verdict = "No key: an eavesdropper or noise, QBER 26.9 % (21 to 33 %)"
        expect(shown.locator(".verdict")).to_have_text(verdict)
        page.get_by_label("time in s").fill("3.5")
        expect(shown.locator(".verdict")).to_contain_text("so far")
        page.close()


def test_what_others_do_to_fibres_and_switches_is_shown(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    """As by commands in another terminal: the dispatcher tells of it."""
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#status")).to_have_text("live")
        for node, port in (("alice", "alice-q0"), ("q1", "2")):
            tell(view, 1.0, "tune", node, port=port, detail="tapped 0.25")
        tell(view, 1.0, "tune", "q1", port="3", detail="193414 GHz")
        tell(view, 1.1, "fault", "q1", detail="stuck 2 -> 3")
        expect(page.locator(".fiber.tapped")).to_have_count(1)
        expect(page.locator(".node.faulty")).to_have_count(1)
        spoken = page.get_by_role("button", name="quantum switch q1, faulty", exact=True)
        expect(spoken).to_be_visible()
        tapped = re.compile("^fibre alice-q0.* dB, somebody measures$")
        expect(page.get_by_role("button", name=tapped)).to_have_count(1)
        page.get_by_role("button", name=re.compile("^fibre alice-q0")).press("Enter")
        expect(page.locator("#facts")).to_contain_text("25 % of the photons")
        page.get_by_role("button", name="quantum switch q1").press("Enter")
        expect(page.locator("#facts")).to_contain_text("stuck 2 -> 3")
        eth2 = {"port": 2, "name": "q1-eth2", "up": True, "photons_in": 1200}
        eth2 |= {"photons_out": 1197, "photons_lost": 3}
        eth2["light"] = {"frequency_mhz": 193_400_000, "tx_power_dbm": 0, "temperature_c": 25}
        known = {"name": "q1", "kind": "quantum-switch", "dpid": "1001", "state": "up"}
        ways = {"ports": [eth2], "paths": [{"in_port": 2, "out_port": 3}]}
        reports = {"devices": [known | ways], "sessions": [], "key_links": []}
        view.timeline.add("devices", START_NS + 12 * 10**8, reports)
        row = ["2", "up", "3", "1,200", "1,197", "3", "193.4 THz", "0 dBm", "-", "25 °C"]
        expect(page.locator("#ports tbody td")).to_have_text(row)
        page.set_viewport_size({"width": 390, "height": 800})  # what is known of a port is long
        page.wait_for_function("() => document.documentElement.scrollWidth <= innerWidth")
        tell(view, 2.0, "fault", "q1", detail="repaired")
        tell(view, 2.0, "tune", "q1", port="2", detail="tapped 0")
        tell(view, 2.0, "tune", "alice", port="alice-q0", detail="tapped 0")
        expect(page.locator(".node.faulty")).to_have_count(0)
        expect(page.locator(".fiber.tapped")).to_have_count(0)
        expect(page.get_by_role("button", name="quantum switch q1", exact=True)).to_be_visible()
        page.close()


def test_light_says_its_rate_and_its_loss(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#status")).to_have_text("live")
        light(view, 1.0)
        light(view, 1.5)  # 100 photons each, of which 40 are lost: 200 in that second
        tell(view, 4.0, "create", "charlie")  # time goes on, and nothing comes
        expect(page.locator("#clock")).to_have_text("4.000 s")
        expect(page.locator(".fiber .flow", has_text="photons/s")).to_have_count(0)
        page.get_by_label("time in s").fill("1.6")
        expect(page.locator(".fiber .flow", has_text="photons/s")).to_have_text(
            ["200 photons/s, 40.0 % lost"]
        )
        page.close()


def test_where_all_processors_are_in_use_it_says_that_it_draws_seldom(
    chromium: Browser, tmp_path: Path, text: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pace, "LIVE_LOOK_S", 0.0)
    idle = 0  # of a clock that goes on
    view = replace(live(tmp_path), pace=pace.Pace(lambda: (idle, time.monotonic_ns())))
    with served(view) as url:
        page = opened(chromium, url, text)
        status = page.locator("#status")
        expect(status).to_have_text("live; drawn once a second, as the computer is busy")
        light(view, 1.0)
        expect(page.locator(".fiber.lit")).to_have_count(3)  # what happens is shown all the same
        page.get_by_label("time in s").fill("0.5")  # what one does oneself is shown at once
        expect(page.locator("#clock")).to_have_text("0.500 s")
        page.get_by_role("button", name="latest").click()
        idle = 1 << 62
        tell(view, 2.0, "create", "charlie")
        expect(status).to_have_text("live")
        page.close()


def test_photons_of_a_block_are_told_of_the_time_in_which_they_flew(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    """A block is one event, however long its light takes: 1,000 within 2 s are 500 a second."""
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        tell(view, 0.9, "open", "q1", port="2", detail="2 -> 3")
        tell(view, 0.9, "open", "q2", port="1", detail="1 -> 2")
        block = {"session": SESSION, "block": 1, "half": 0, "photons": 1000}
        tell(view, 1.0, "create", "alice", **block)
        tell(view, 1.0, "send", "alice", port="alice-q0", **block)
        tell(view, 1.3, "create", "charlie")  # time goes on, and nothing has come yet
        expect(page.locator("#clock")).to_have_text("1.300 s")
        expect(page.locator("#rates .u-value").nth(1)).to_have_text("-")  # not known yet
        expect(page.locator("#rates")).not_to_contain_text("10,000")
        tell(view, 2.5, "create", "charlie")
        expect(page.locator("#clock")).to_have_text("2.500 s")
        expect(page.locator(".fiber.lit.flowing")).to_have_count(3)
        expect(page.locator("#rates")).not_to_contain_text("10,000")  # all of them at once
        tell(view, 3.0, "arrive", "bob", port="bob-q0", lost=400, **block)
        tell(view, 3.5, "create", "charlie")
        label = page.locator(".fiber .flow", has_text="photons/s")
        expect(label).to_have_text(["500 photons/s, 40.0 % lost"])
        row = ["alice → bob", "q1, q2", "500", "40.0", "stands"]
        expect(page.locator("#paths tbody td")).to_have_text(row)
        rates, losses = page.locator("#rates .u-value"), page.locator("#losses .u-value")
        page.get_by_label("time in s").fill("3.05")
        expect(rates.nth(1)).to_have_text(re.compile("^(500|476.2)$"))  # 2 s are 20 or 21 tenths
        expect(rates.nth(2)).to_have_text(re.compile("^(300|285.7)$"))
        expect(losses.nth(1)).to_have_text("40")
        page.close()


SENT_ON = """async () => {
  const { apply, blank } = await import("./state.js");
  const { rate } = await import("./light.js");
  const state = blank(), block = { session: "1", block: 1, half: 0 };
  const here = { what: "event", node: "alice", port: "alice-q0", ...block };
  apply(state, { ...here, kind: "arrive", t: 1.0, photons: 100, lost: 20 }, {});
  apply(state, { ...here, kind: "send", t: 1.1, photons: 100, lost: 20 }, {});
  return rate(state, "alice-q0");
}"""


def test_light_that_is_sent_on_by_the_port_it_came_to_is_counted_once(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with served(live(tmp_path)) as url:
        report = opened(chromium, url, text).evaluate(SENT_ON)
    assert report == {"photons": 100, "lost": 0.2}


def test_a_light_path_of_milliseconds_is_seen_for_a_second(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        light(view, 1.0)
        tell(view, 1.01, "close", "q1", port="2")
        tell(view, 1.01, "close", "q2", port="1")
        expect(page.locator("#clock")).to_have_text("1.010 s")
        expect(page.locator(".fiber.lit")).to_have_count(0)
        tell(view, 3.0, "create", "charlie")
        expect(page.locator(".fiber.glow")).to_have_count(0)
        page.get_by_label("time in s").fill("1.9")
        expect(page.locator(".fiber.glow")).to_have_count(3)
        expect(page.locator("#paths tbody td").last).to_have_text("closed")
        page.close()


def test_a_memory_holds_what_was_not_let_go(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        light(view, 1.0)  # bob has stored 100
        cells = page.locator("#memories tbody td")
        taken = {"session": SESSION, "block": 2, "half": 0, "photons": 60}
        tell(view, 2.0, "gather", "bob", detail="60 of 100 of 1/0, still stored", **taken)
        expect(cells).to_have_text(["bob", "100", "0.998"])  # the others stay
        more = {"session": SESSION, "block": 3, "half": 0, "photons": 50}
        detail = "10 of 40 of 1/0, 40 of 60 of 2/0, still stored, the rest let go"
        tell(view, 3.0, "gather", "bob", detail=detail, **more)
        expect(cells).to_have_text(["bob", "50", "1.998"])
        page.close()


def test_decisions_say_whose_and_why(chromium: Browser, tmp_path: Path, text: list[str]) -> None:
    view = live(tmp_path)
    asked = {"session": SESSION, "service": "bb84", "from": "alice", "to": "bob"}
    way = {"begin": "alice-q0", "end": "bob-q0", "by": ["q1", "q2"], "loss_db": 1.25}
    facts: list[dict[str, Any]] = [
        {"event": "granted", **asked, "light": [way]},
        {"event": "refused", **asked, "session": "2" * 16, "detail": "BUSY"},
        {"event": "forbidden", **asked, "session": "3" * 16, "detail": "rule 2"},
        {"event": "path_ready", "session": SESSION, "setup_ms": 3.9},
        {"event": "override", "name": "alice", "rate_hz": 2_000_000, "fec": "golay"},
        {"event": "torn_down", "session": SESSION, "detail": "FIN"},
        {"event": "light_after", "session": "4" * 16, "ends": [], "after": {"session": SESSION}},
    ]
    for number, fact in enumerate(facts):
        view.timeline.add("controller", START_NS + number * 10**9, fact)
    with served(view) as url:
        page = opened(chromium, url, text)
        way_told = "light of least loss: alice-q0 → bob-q0 by q1, q2 (1.25 dB)"
        expect(page.locator("#decisions li")).to_have_text(
            [
                "6.000 s c0 has light now: session 444444, which waited for session bdb225 to give"
                " it back",
                "5.000 s c0 ended: session bdb225; its connection was closed",
                "4.000 s c0 alice shall use rate 2 MHz, fec golay",
                "3.000 s c0 light path of session bdb225 stands after 3.9 ms",
                "2.000 s c0 forbidden by the policy: session 333333; alice → bob, bb84; rule 2",
                "1.000 s c0 refused: session 222222; alice → bob, bb84; BUSY: another session uses"
                " these fibres",
                f"0.000 s c0 granted: session bdb225; alice → bob, bb84; {way_told}",
            ]
        )
        row = page.locator("#sessions tbody tr", has_text="bdb225").locator("td")
        expect(row.nth(1)).to_have_text("bb84")
        expect(row.nth(2)).to_have_text("alice → bob")
        page.close()


def test_the_newest_handshake_is_drawn_when_one_looks_at_it(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    light(view, 1.0)
    tell(view, 3.0, "create", "charlie")
    with served(view) as url:
        page = opened(chromium, url, text)
        expect(page.locator("#clock")).to_have_text("3.000 s")
        page.locator("#handshake").scroll_into_view_if_needed()
        expect(page.locator("#handshake")).to_have_text("drawn")
        page.close()


HOURS = """async () => {
  const { apply, blank } = await import("./state.js");
  const state = blank();
  for (let n = 0; n < 72_000; n++) { // two hours, ten sessions a second
    const here = { what: "event", t: n / 10, node: "alice", session: n % 2 ? String(n) : "stays" };
    apply(state, { ...here, kind: "create", photons: 1 }, {});
  }
  const { sessions, buckets } = state;
  return [sessions.size, sessions.get("stays").pairs, sessions.has("71999"), buckets.size];
}"""


def test_what_is_known_of_a_network_does_not_grow_with_its_age(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    with served(live(tmp_path)) as url:
        sessions, pairs, newest, buckets = opened(chromium, url, text).evaluate(HOURS)
    assert sessions <= 300
    assert (pairs, newest) == (36_000, True)  # of one that goes on, and is the oldest
    assert buckets <= 601  # a minute, ten a second


def test_a_network_that_is_gone_is_told(chromium: Browser, tmp_path: Path) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = chromium.new_page()
        page.goto(url)
        expect(page.locator("#status")).to_have_text("live")
    expect(page.locator("#status")).to_have_text("the network has ended")
    page.get_by_role("button", name="host alice").click()
    page.get_by_role("button", name="reload the policy").click()
    expect(page.locator("#chosen .failed")).to_contain_text("has the network ended?")
    page.close()


def test_a_network_that_goes_on_can_be_paused_and_played_at_another_speed(
    chromium: Browser, tmp_path: Path, text: list[str]
) -> None:
    view = live(tmp_path)
    with served(view) as url:
        page = opened(chromium, url, text)
        tell(view, 1.0, "create", "charlie")
        clock = page.locator("#clock")
        expect(clock).to_have_text("1.000 s")
        page.get_by_role("button", name="pause").click()
        expect(page.locator("#status")).to_have_text("live, looking back")
        tell(view, 100.0, "create", "charlie")
        expect(page.locator("#slider")).to_have_attribute("max", "100")  # it can be gone to
        expect(clock).to_have_text("1.000 s")
        page.get_by_label("speed").select_option("10")
        page.wait_for_timeout(2000)  # while it is paused no time passes, which it would catch up on
        begun = time.monotonic()
        page.get_by_role("button", name="play").click()
        page.wait_for_function("() => parseFloat(document.getElementById('clock').value) > 21")
        assert 1.5 < time.monotonic() - begun < 30.0  # 20 s at ten a second
        page.get_by_label("speed").select_option("0.01")
        page.get_by_role("button", name="pause").click()
        page.get_by_role("button", name="latest").click()
        expect(clock).to_have_text("100.000 s")
        expect(page.locator("#status")).to_have_text("live")
        page.close()
