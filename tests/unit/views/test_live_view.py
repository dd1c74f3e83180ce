"""The live view without a browser: messages, acts, and who may ask the server what."""

import base64
import hashlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from limits import SOON_S, wait_until
from live_page import live, served
from recorded_run import MS, START_NS, record_run

from qmn.__main__ import described as parser
from qmn.timeouts import LIVE_LIST_S, LIVE_SELDOM_S
from topologies.system.processes.programs import ROOT
from views.live import acts, pace
from views.live.address import Place, listen, place_given
from views.live.layout import placed
from views.live.pages import Pages
from views.live.server import AT_ONCE, PAGE
from views.live.sources import timeline_of_run
from views.live.timeline import Timeline
from wire import typed_json
from wire.results.run_result import NetworkFacts

EXAMPLES = {
    "link": {"a": "alice", "b": "q1", "state": "down"},
    "tap": {"a": "alice", "b": "q1", "fraction": "0.5"},
    "classical": {"a": "alice", "b": "q1", "mw": "1"},
    "calibrate": {"a": "alice", "b": "q1"},
    "stuck": {"switch": "q1", "in_port": "2", "out_port": "3"},
    "temperature": {"switch": "q1", "celsius": "-5.5"},
    "repair": {"switch": "q1"},
    "set": {"host": "alice", "setting": "rate-hz", "value": "1000"},
    "policy": {},
    "send": {"from": "alice", "to": "bob", "text": "hello; rm -rf /"},
}


def test_a_run_is_told_in_the_order_of_time(tmp_path: Path) -> None:
    timeline = timeline_of_run(record_run(tmp_path))
    texts, position, missed = timeline.after(0, 1000)
    messages = [json.loads(text) for text in texts]
    assert timeline.ended
    assert (timeline.origin_ns, position, missed) == (START_NS + 2 * MS, len(messages), 0)
    times = [message["t"] for message in messages]
    assert times == sorted(times)
    kinds = [message.get("kind", message["what"]) for message in messages]
    assert kinds == [
        *("controller", "controller", "open", "open", "create", "send", "arrive"),
        *("bell-measure", "close", "job", "job"),
    ]
    assert messages[6]["t"] == pytest.approx(2e-3)  # bob's light, 4 ms, since the set-up at 2 ms
    assert messages[0]["t"] == 0  # found before that
    assert messages[-1]["bell_pairs"] == 100


def test_the_command_shows_a_run_until_ctrl_c(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "qmn", "live", str(record_run(tmp_path)), "--no-browser"]
    with subprocess.Popen(
        command, cwd=Path(acts.__file__).parents[2], stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdout is not None
        text, _colon, url = program.stdout.readline().strip().partition(": ")
        assert text == "live view"
        drawn = json.loads(answer(f"{url}network.json")[1])
        assert (drawn["live"], drawn["acts"]) == (False, False)
        program.send_signal(signal.SIGINT)
        assert program.wait(SOON_S) == 0


def test_a_reader_who_is_slow_is_told_how_much_was_missed() -> None:
    timeline = Timeline(0, most=3)
    for number in range(5):
        timeline.add("event", number * 10**9, {"number": number})
    messages, position, missed = timeline.after(1, 2)
    numbers = [json.loads(text)["number"] for text in messages]
    assert (numbers, position, missed) == ([2, 3], 4, 1)
    assert timeline.after(4, 2) == (['{"t":4.0,"what":"event","number":4}'], 5, 0)
    assert timeline.after(5, 2) == ([], 5, 0)


def test_a_page_is_told_seldom_as_long_as_no_processor_is_idle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pace, "LIVE_LOOK_S", 0.0)
    idle = [0, 100, 102, 112, 142, 242]  # of 100 clocks each time: 100, 2, 10, 30 and 100 %
    counted = ((each, 100 * number) for number, each in enumerate(idle))
    seen = pace.Pace(lambda: next(counted))
    often, seldom = LIVE_LIST_S, LIVE_SELDOM_S
    assert [seen.look() for _ in idle[1:]] == [often, seldom, seldom, often, often]


def test_the_kernel_has_counted_what_processors_do() -> None:
    idle, every = pace.processor_times()
    clocks_per_s = os.sysconf("SC_CLK_TCK")
    up_s = float(Path("/proc/uptime").read_text().split()[0])
    assert 0 <= idle <= every
    assert every / clocks_per_s <= 1.1 * (os.cpu_count() or 1) * up_s


@pytest.mark.parametrize("name", acts.VERBS)
def test_every_act_is_a_command_that_qmn_takes(name: str) -> None:
    words = acts.command_for({"act": name, **EXAMPLES[name]})
    parsed = parser(words).parse_args(words)
    assert set(EXAMPLES[name].values()) <= {
        value if isinstance(value, str) else f"{value:g}"
        for value in vars(parsed).values()
        if isinstance(value, str | int | float)
    }


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "an act is an object"),
        ({"act": "reboot"}, "unknown act 'reboot': one of link"),
        ({"act": "repair"}, "repair has the fields switch"),
        ({"act": "repair", "switch": "q1", "more": "x"}, "repair has the fields switch"),
        ({"act": "repair", "switch": 1}, "switch of repair is a text"),
        ({"act": "repair", "switch": ""}, "switch of repair is a text"),
        ({"act": "repair", "switch": "q\0"}, "switch of repair is a text"),
        ({"act": "repair", "switch": "q" * 5000}, "switch of repair is a text"),
        ({"act": "repair", "switch": "--help"}, "switch of repair '--help' begins as an option"),
    ],
)
def test_what_is_no_act_is_refused(given: object, words: str) -> None:
    with pytest.raises(acts.BadAct, match=words):
        acts.command_for(given)


def answer(url: str, body: bytes | None = None, **headers: str) -> tuple[int, str]:
    """Return status and text of an answer."""
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    request = urllib.request.Request(url, body, names)  # noqa: S310 (our own http)
    try:
        with urllib.request.urlopen(request, timeout=SOON_S) as response:  # noqa: S310
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_only_who_knows_the_address_is_answered(tmp_path: Path) -> None:
    with served(live(tmp_path)) as url:
        assert answer(url)[0] == 200
        assert json.loads(answer(f"{url}network.json")[1])["name"] == "a network"
        base = url.rsplit("/", 2)[0]
        for path in ("/", "/network.json", "/act", "/wrong/", f"/{'x' * 22}/network.json"):
            assert answer(base + path)[0] == 404, path
        assert answer(f"{url}../../../etc/passwd")[0] in (403, 404)
        assert answer(f"{url}%2e%2e/server.py")[0] in (403, 404)


@pytest.mark.parametrize("path", ["", "network.json", "wrong"])
def test_browsers_guess_no_type_and_neither_keep_an_answer_nor_name_its_address(
    tmp_path: Path, path: str
) -> None:
    with served(live(tmp_path)) as url:
        place = urllib.parse.urlsplit(url)
        with closing(http.client.HTTPConnection(place.netloc, timeout=SOON_S)) as connection:
            connection.request("GET", place.path + path)
            headers = connection.getresponse().headers
    names = "X-Content-Type-Options", "Referrer-Policy", "Cache-Control"
    assert [headers[name] for name in names] == ["nosniff", "no-referrer", "no-store"]


def test_another_page_of_the_browser_may_not_ask(tmp_path: Path) -> None:
    act = json.dumps({"act": "policy"}).encode()
    with served(live(tmp_path)) as url:
        assert answer(url, Host="evil.example")[0] == 403
        assert answer(f"{url}network.json", Origin="http://evil.example")[0] == 403
        assert answer(f"{url}act", act, Content_Type="text/plain")[0] == 415
        json_type = {"Content_Type": "application/json"}
        assert answer(f"{url}act", act, Origin="http://127.0.0.1:1", **json_type)[0] == 403
    assert not (tmp_path / acts.ACTS).exists()


@pytest.mark.parametrize("body", [b"", b"{", b"[" * 30_000, b'{"act": 5}', b"\xff"])
def test_what_is_no_request_changes_nothing(tmp_path: Path, body: bytes) -> None:
    with served(live(tmp_path)) as url:
        status, text = answer(f"{url}act", body, Content_Type="application/json")
    assert (status, json.loads(text)["status"]) == (400, 2)
    assert not (tmp_path / acts.ACTS).exists()


def test_a_view_to_be_looked_at_takes_no_acts(tmp_path: Path) -> None:
    act = json.dumps({"act": "policy"}).encode()
    with served(live(tmp_path, acts=False)) as url:
        assert answer(f"{url}act", act, Content_Type="application/json")[0] == 403


def streamed(url: str) -> list[tuple[str, Any]]:
    """Return the server-sent events until the last."""
    with urllib.request.urlopen(f"{url}messages?after=1", timeout=SOON_S) as response:  # noqa: S310
        blocks = response.read().decode().strip().split("\n\n")
    fields = [dict(line.split(": ", 1) for line in block.splitlines()) for block in blocks]
    return [(each["event"], json.loads(each["data"])) for each in fields]


def test_messages_come_until_the_network_has_ended(tmp_path: Path) -> None:
    view = live(tmp_path, most=2)
    for number in range(4):
        view.timeline.add("event", START_NS, {"number": number})
    view.timeline.end()
    with served(view) as url:
        assert streamed(url) == [
            ("missed", 1),
            ("messages", [{"t": 0.0, "what": "event", "number": n} for n in (2, 3)]),
            ("pause", 20),
            ("ended", None),
        ]
        assert answer(f"{url}messages?after=x")[0] == 400


def test_lists_that_are_full_are_followed_by_the_rest_at_once(tmp_path: Path) -> None:
    """Of a network that goes on, in which nothing happens any more."""
    view, count = live(tmp_path, most=3 * AT_ONCE), 2 * AT_ONCE + 1
    view.timeline.add_all("event", [(START_NS, {"number": n}) for n in range(count)])
    lists: list[int] = []
    with (
        served(view) as url,
        urllib.request.urlopen(f"{url}messages", timeout=SOON_S) as response,  # noqa: S310
    ):
        while sum(lists) < count:
            if response.readline() == b"event: messages\n":
                response.readline()  # its number
                lists.append(len(json.loads(response.readline().removeprefix(b"data: "))))
    assert lists == [AT_ONCE, AT_ONCE, 1]


STARTS_NETWORKS = [
    "run sdc",
    "run qkd",
    "run load",
    "run keys",
    "run vpn",
    "netqasm DIR",
    "cli sdc",
]
STARTS_NETWORKS += ["lab demo flapping", "lab attack replay", "lab published paper"]
STARTS_NETWORKS += ["lab sweep sdc --emulate"]


@pytest.mark.parametrize("words", STARTS_NETWORKS)
def test_every_verb_that_starts_networks_can_serve_a_page(words: str) -> None:
    lines = words.split()
    assert parser(lines).parse_args([*lines, "--live"]).live
    assert not parser(lines).parse_args(lines).live


def test_a_script_has_its_own_arguments_behind_its_file() -> None:
    words = ["script", "--live", "first.py", "--seed"]
    given = parser(words).parse_args(words)
    assert (given.live, given.file, given.words) == (True, Path("first.py"), ["--seed"])


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("lab sweep sdc --depolarizing 0", "networks to look at start here with --emulate"),
        ("lab sweep sdc --emulate --scheduler tcp://h:1", "without --scheduler"),
        ("lab attack intercept-resend", "is on light alone"),
    ],
)
def test_what_starts_no_network_here_has_no_page(
    words: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [*words.split(), "--live"]
    given = parser(lines).parse_args(lines)
    assert given.call(given) == 1
    assert why in capsys.readouterr().err


def test_a_page_that_is_asked_for_again_and_again_does_not_keep_a_network(tmp_path: Path) -> None:
    asked, over = 0, threading.Event()

    def ask(url: str) -> None:
        nonlocal asked
        while not over.is_set():
            with suppress(OSError):
                asked += answer(url)[0] == 200

    try:
        with served(live(tmp_path)) as url:  # which says if the server does not end
            threading.Thread(target=ask, args=(url,)).start()
            wait_until(lambda: asked, "an answer")
    finally:
        over.set()


@contextmanager
def leading_to(socket: Path) -> Iterator[tuple[int, "subprocess.Popen[str]"]]:
    """Start the program that leads from a port of the loopback to a socket; yield both."""
    command = [sys.executable, "-m", "views.live.loopback", "0", str(socket)]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=Path(acts.__file__).parents[2], stdin=pipe, stdout=pipe, text=True
    ) as program:
        assert program.stdout is not None
        try:
            yield int(program.stdout.readline()), program
        finally:
            program.communicate(timeout=SOON_S)  # ends its input


def test_the_page_of_a_container_is_reached_by_a_port_that_leads_there(tmp_path: Path) -> None:
    socket, view = tmp_path / "socket", live(tmp_path)
    with leading_to(socket) as (port, program):
        with pytest.raises(OSError, match=r"reset|closed"):  # nothing is served yet
            answer(f"http://127.0.0.1:{port}/")
        with served(view, Place(port, socket)) as address:
            assert address.startswith(f"http://127.0.0.1:{port}/")
            assert "<title>" in answer(address)[1]
            assert answer(f"http://127.0.0.1:{port}/network.json")[0] == 404
            view.timeline.add("event", START_NS, {"number": 1})
            program.send_signal(signal.SIGINT)  # Ctrl-C is for the network, whose page goes on
            view.timeline.end()
            assert [event for event, _data in streamed(address)] == ["ended"]
    assert program.returncode == 0


def test_in_a_container_the_page_is_where_its_environment_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("QMN_LIVE_SOCKET", raising=False)
    assert place_given() is None
    monkeypatch.setenv("QMN_LIVE_SOCKET", "/live/socket")
    monkeypatch.setenv("QMN_LIVE_PORT", "8000")
    assert place_given() == Place(8000, Path("/live/socket"))


def test_a_port_that_is_taken_is_named_with_the_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=f"^port {port} of 127.0.0.1 is taken: .* --port$"):
            listen(Place(port))


def test_a_network_of_a_command_finds_its_place_in_the_folder_of_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = Pages(tmp_path)
    (tmp_path / "port").write_text("8000")
    monkeypatch.setenv("QMN_LIVE_PAGES", str(tmp_path))
    with pages.one_more("a network") as number:
        monkeypatch.setenv("QMN_LIVE_NUMBER", str(number))
        assert place_given() == Place(8000, tmp_path / "1" / "socket", pages.secret, 1)


OPENER = """#!/bin/sh
cp "${1#file://}" report.new && stat -c %u:%a "${1#file://}" >>report.new && id -u >>report.new
env >>report.new; mv report.new report; while [ -e report ]; do sleep 0.1; done
"""
ADDRESS = "http://127.0.0.1:1/the-secret/"
SAY = """
import sys
from views.live.address import say
say(sys.stdin.readline().strip(), True)
sys.stdin.read()
"""
ROOT_ALONE = pytest.mark.skipif(os.geteuid() != 0, reason="only root is somebody else's by sudo")
NOBODY = "65534"


def command_lines() -> str:
    """Return those of all processes, as every user sees them."""
    lines = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            lines.append(file.read_text(errors="replace"))
    return "\n".join(lines)


@contextmanager
def opened(
    as_user: list[str], further: dict[str, str]
) -> Iterator[tuple[Path, "subprocess.Popen[bytes]"]]:
    """Let a program open the page; yield the folder that its opener writes to, and the program."""
    with TemporaryDirectory(prefix="qmn-browser-") as folder:
        at = Path(folder)
        at.chmod(0o777)
        opener = at / "xdg-open"
        opener.write_text(OPENER.replace("report", f"{at}/report"))
        opener.chmod(0o755)
        environment = {
            "PATH": f"{at}:{os.environ['PATH']}",
            "DISPLAY": ":0",
            "BROWSER": str(opener),
            "PYTHONPATH": str(ROOT),
            **further,
        }
        command = [*as_user, sys.executable, "-c", SAY]
        with subprocess.Popen(command, stdin=subprocess.PIPE, env=environment) as program:
            assert program.stdin is not None
            program.stdin.write(f"{ADDRESS}\n".encode())
            program.stdin.flush()
            yield at, program


@pytest.mark.parametrize(
    "by_sudo", [pytest.param(True, marks=ROOT_ALONE), False], ids=["by sudo", "as a user"]
)
def test_a_browser_gets_the_address_by_a_file_of_its_user_and_by_no_command_line(
    by_sudo: bool,
) -> None:
    root = os.geteuid() == 0
    user = NOBODY if root else str(os.getuid())
    dropped = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
    by = {"SUDO_USER": "nobody", "SUDO_UID": NOBODY} if by_sudo else {}
    with opened(dropped if root and not by_sudo else [], by) as (folder, program):
        deadline, report, seen = time.monotonic() + SOON_S, folder / "report", ""
        while not report.exists():
            assert time.monotonic() < deadline, "nobody has opened a browser"
            ended = program.poll() is not None and not report.exists()
            assert not ended, f"no browser was opened: can other users enter {ROOT}?"
            seen += command_lines()
        seen += command_lines()  # the opener still runs
        found = re.findall(r"file://(\S+?/qmn-live-\S+?\.html)", seen)
        program.communicate(timeout=SOON_S)
        text = report.read_text()
    assert found
    assert f"url={ADDRESS}" in text
    assert f"{user}:600\n{user}\n" in text  # owner and mode of the file, and who opens it
    assert "the-secret" not in seen
    assert not any(map(os.path.exists, found))
    if by_sudo:
        assert {"DISPLAY=:0", f"XDG_RUNTIME_DIR=/run/user/{NOBODY}"} <= set(text.splitlines())


def test_a_thousand_hosts_have_places_of_their_own() -> None:
    switches = [{"name": f"q{number}"} for number in range(32)]
    fibers = [
        {"a": {"node": f"h{n}", "port": f"h{n}-q0"}, "b": {"node": f"q{n % 32}", "port": f"{n}"}}
        for n in range(1024)
    ]
    fibers += [
        {"a": {"node": f"q{n}", "port": "2000"}, "b": {"node": "q0", "port": f"{2000 + n}"}}
        for n in range(1, 32)
    ]
    facts = {"addresses": {f"h{n}": f"10.0.{n // 250}.{n % 250}" for n in range(1024)}}
    facts |= {"source": "h0", "fibers": fibers, "switches": switches, "copper": []}  # type: ignore[dict-item]
    places = placed(typed_json.read(NetworkFacts, facts))
    assert len(places) == 1024 + 32
    assert len(set(places.values())) == len(places)


def test_the_chart_library_is_the_published_one() -> None:
    """The SHA-512 of the package is that of the registry; its files are these."""
    content = json.loads((PAGE / "uplot" / "origin.json").read_text())
    files = {
        name: base64.b64encode(hashlib.sha512((PAGE / "uplot" / name).read_bytes()).digest())
        for name in content["sha512"]
    }
    assert {name: value.decode() for name, value in files.items()} == content["sha512"]
    assert "MIT License" in (PAGE / "uplot" / "LICENSE").read_text()
