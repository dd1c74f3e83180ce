"""The live view of a network that runs: what it tells, and what it does when it is asked."""

import json
import re
import signal
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from conftest import qmn, wait_until
from loaded import Running, running_qmn
from test_emulated_sweep import require_theory

from topologies.system.runs.runtime import MACHINE_PAGES
from views.live.acts import ACTS

ADDRESS = re.compile(r"live view: (http\S+)")
DEADLINE_S = 60.0


class Reader(threading.Thread):
    """Reads the server-sent events of a page to their end."""

    def __init__(self, url: str) -> None:
        super().__init__()
        self.messages: list[dict[str, Any]] = []
        self.ended = False
        self._url = url
        self.start()

    def run(self) -> None:
        with urllib.request.urlopen(f"{self._url}messages", timeout=DEADLINE_S) as response:  # noqa: S310
            event = ""
            for line in response:
                name, _colon, value = line.decode().strip().partition(": ")
                if name == "event":
                    event = value
                elif name == "data" and event == "messages":
                    self.messages += json.loads(value)
                self.ended |= event == "ended"

    def has(self, what: str, **fields: Any) -> bool:
        return any(
            message["what"] == what and fields.items() <= message.items()
            for message in list(self.messages)
        )


@contextmanager
def started(tmp_path: Path, *options: str) -> Iterator[tuple[Running, str]]:
    """Start a network with its page; yield its runner and the address."""
    words = ["cli", "sdc", "--live", *options, "--runs", str(tmp_path)]
    with running_qmn(*words, typed=True, end_s=DEADLINE_S) as network:
        found = next(filter(None, map(ADDRESS.search, network.stdout)))
        page = f"{found[1]}1/"  # of the first network of a command
        wait_until(lambda: answers(f"{page}network.json"), "its page", DEADLINE_S)
        yield network, page


@contextmanager
def network_with_a_page(tmp_path: Path) -> Iterator[str]:
    """Run a network with its page, and end it as its user would; yield the address."""
    with started(tmp_path, "--captures", "full") as (network, url):
        assert network.stdin is not None
        yield url
        network.stdin.write("exit\n")
        network.finish(DEADLINE_S)
        assert network.returncode == 0


def act(url: str, **fields: str) -> dict[str, Any]:
    """Have something done; return the result."""
    request = urllib.request.Request(  # noqa: S310
        f"{url}act", json.dumps(fields).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=DEADLINE_S) as response:  # noqa: S310
        done: dict[str, Any] = json.loads(response.read())
    return done


def test_one_sees_and_acts(tmp_path: Path) -> None:
    with network_with_a_page(tmp_path) as url:
        with urllib.request.urlopen(f"{url}network.json", timeout=DEADLINE_S) as response:  # noqa: S310
            drawn = json.load(response)
        assert {node["name"] for node in drawn["nodes"]} >= {"alice", "bob", "charlie", "q1", "s1"}
        assert drawn["names"]["1"] == "s1"  # as its topology says
        assert (len(drawn["fibers"]), drawn["live"], drawn["acts"]) == (5, True, True)
        reader = Reader(url)

        done = act(url, act="send", **{"from": "alice", "to": "bob", "text": "hello"})
        assert (done["status"], done["command"]) == (0, ["send", "alice", "bob", "hello"])
        assert "bob received 'hello'" in done["output"]
        wait_until(lambda: reader.has("event", node="bob", kind="bell-measure"), "light at bob")
        wait_until(lambda: reader.has("controller", event="granted"), "the controller's word")
        wait_until(lambda: reader.has("act", status=0), "the act")
        wait_until(lambda: reader.has("devices"), "what hosts report")
        with urllib.request.urlopen(f"{url}handshake", timeout=DEADLINE_S) as response:  # noqa: S310
            handshake = response.read().decode()
        assert "Setup SDC" in handshake
        assert "bell-measure" in handshake

        dpid = int(next(dpid for dpid, name in drawn["names"].items() if name == "q1"))
        assert act(url, act="link", a="alice", b="q1", state="down")["status"] == 0
        cut = {"event": "port", "dpid": dpid, "up": False}
        wait_until(lambda: reader.has("controller", **cut), "the cut fibre")
        refused = act(url, act="send", **{"from": "alice", "to": "bob", "text": "hello"})
        assert refused["status"] == 1
        assert "is cut" in refused["output"]
        assert act(url, act="link", a="q1", b="alice", state="up")["status"] == 0
        done = act(url, act="send", **{"from": "alice", "to": "bob", "text": "again"})
        assert (done["status"], "bob received 'again'" in done["output"]) == (0, True), done
        wait_until(lambda: reader.has("controller", **{**cut, "up": True}), "the mended fibre")
        done = act(url, act="tap", a="alice", b="q1", fraction="1")
        assert (done["status"], done["output"][:7]) == (0, "1 fibre")
        assert act(url, act="tap", a="alice", b="q9", fraction="1")["status"] == 1
    reader.join(DEADLINE_S)
    assert reader.ended
    noted = [json.loads(line) for line in (tmp_path / "latest" / ACTS).read_text().splitlines()]
    commands = [" ".join(each["command"][:-3]) for each in noted]
    around = ["send", "set link"]
    assert commands == [*around, *around, "send", "set tap", "set tap"]


def test_a_run_has_its_page_as_long_as_it_lasts(tmp_path: Path) -> None:
    done = qmn("--live", "--message", "hello", runs=tmp_path)
    assert done.returncode == 0, done.stderr
    found = ADDRESS.search(done.stdout)
    assert found
    assert not answers(found[1])


@pytest.mark.waits
def test_networks_apart_have_their_pages_at_one_address_and_measure_what_theory_says(
    tmp_path: Path,
) -> None:
    long = ["--message", "x" * 5000, "--rate-hz", "4000", "--frame-bytes", "32"]  # 5 s of light
    grid = ["--emulate", "--workers", "2", "--depolarizing", "0,0.001", *long]
    out = ["--out", str(tmp_path)]
    with running_qmn("lab", "sweep", "sdc", *grid, *out, "--live", end_s=DEADLINE_S) as sweep:
        url = next(filter(None, map(ADDRESS.search, sweep.stdout)))[1]
        wait_until(lambda: said_at(f"{url}networks")["running"] == [1, 2], "two pages", DEADLINE_S)
        readers = [Reader(f"{url}{number}/") for number in (1, 2)]
        for number in (1, 2):
            shown = said_at(f"{url}{number}/network.json")
            assert (shown["number"], shown["live"], shown["acts"]) == (number, True, True)
            done = act(f"{url}{number}/", act="repair", switch="q1")
            assert (done["status"], done["output"][:3]) == (0, "q1:"), done
        for reader in readers:
            reader.join(DEADLINE_S)
            assert reader.ended
            assert reader.has("event", node="bob", kind="bell-measure")
        wait_until(lambda: not said_at(f"{url}networks")["running"], "their end", DEADLINE_S)
    assert sweep.returncode == 0
    assert not answers(url)
    require_theory(tmp_path, "0.0", "0.001")


def test_all_networks_of_a_machine_have_one_page(tmp_path: Path) -> None:
    with running_qmn("live", "--all", "--no-browser", end_s=DEADLINE_S) as page:
        url = next(filter(None, map(ADDRESS.search, page.stdout)))[1]
        try:
            with running_qmn("cli", "sdc", "--runs", str(tmp_path), typed=True) as network:
                wait_until(
                    lambda: said_at(f"{url}networks")["running"] == [1], "its page", DEADLINE_S
                )
                (name,) = said_at(f"{url}networks")["names"].values()
                assert name.endswith((tmp_path / "latest").resolve().name)
                assert said_at(f"{url}1/network.json")["number"] == 1
                assert network.stdin is not None
                network.stdin.write("exit\n")
                network.stdin.flush()
            assert said_at(f"{url}networks")["running"] == []
        finally:
            page.send_signal(signal.SIGINT)
    assert page.returncode == 0
    assert not MACHINE_PAGES.exists()


def said_at(url: str) -> dict[str, Any]:
    """Return what an address says."""
    with urllib.request.urlopen(url, timeout=DEADLINE_S) as response:  # noqa: S310
        texts: dict[str, Any] = json.load(response)
    return texts


def test_a_page_ends_with_a_runner_that_was_killed(tmp_path: Path) -> None:
    with started(tmp_path) as (runner, url):
        assert answers(url)
        runner.kill()
        wait_until(lambda: not answers(url), "the end of the page", DEADLINE_S)


def answers(url: str) -> bool:
    """Return whether somebody serves the page."""
    try:
        with urllib.request.urlopen(url, timeout=10) as response:  # noqa: S310
            return int(response.status) == 200
    except OSError:
        return False
