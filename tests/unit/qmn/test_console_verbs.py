"""The output of the verbs that ask the controller."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S

from qmn.changes.controller import set_host
from qmn.running import controller_console, light_paths, tables
from qmn.running.controller_console import NoAnswer, ask
from topologies.system.processes.owners import this_process
from views.verbs import devices

SWITCH = {
    "name": "q1",
    "kind": "quantum-switch",
    "dpid": "0000000000001001",
    "state": "up",
    "heard_s_ago": 0.2,
    "ports": [
        {"port": 1, "name": "q1-eth1", "up": True, "packets_in": 9, "light": None},
        {
            "port": 2,
            "name": "q1-eth2",
            "up": False,
            "photons_in": 4000,
            "photons_out": 10,
            "photons_lost": 3,
            "light": {"frequency_mhz": 193_400_000, "tx_power_dbm": -1.5, "rx_power_dbm": 0.0},
        },
    ],
    "paths": [{"in_port": 2, "out_port": 7}],
}
HOST = {
    "name": "bob",
    "kind": "host",
    "state": "silent",
    "features": ["store", "measure"],
    "memory_qubits": 4000,
    "heard_s_ago": 61.2,
    "ports": [{"name": "bob-q0", "up": False}],
    "sessions": {"sending": 1, "receiving": 2, "serving": 0},
    "pairs_sent": 1,
    "pairs_made": 2,
    "pairs_received": 3000,
    "pairs_lost": 4,
    "symbol_errors": 5,
    "in_use": {
        "rate_hz": 1000,
        "frame_bytes": 64,
        "fec": "golay",
        "interleave": "on",
        "wavelength_pm": 1_550_120,
    },
    "overrides": {"rate_hz": 1000},
}
UNHEARD = {"name": "eve", "kind": "host", "state": "never heard"}
PATHS = {
    "paths": [
        {
            "session": "07",
            "from": "alice",
            "to": "bob",
            "source": "charlie",
            "begin": "alice-q0",
            "end": "bob-q0",
            "loss_db": 0.5,
            "hops": [
                {"dpid": "0000000000001001", "in_port": 2, "out_port": 7},
                {"dpid": "0000000000001002", "in_port": 1, "out_port": 3},
            ],
        }
    ],
    "fibers": [
        {"dpid": "0000000000001001", "port": 2, "to": "alice-q0", "up": True},
        {"dpid": "0000000000001001", "port": 7, "to": "0000000000001002:1", "up": False},
    ],
}
SESSIONS = [
    {"session": "07", "from": "alice", "to": "bob", "waits_for_light": False},
    {"session": "08", "from": "bob", "to": "alice", "waits_for_light": True},
]

Answer = Callable[[dict[str, Any]], bytes]


def well(request: dict[str, Any]) -> bytes:
    """Answer as the controller does."""
    answers = {"devices": [SWITCH, HOST, UNHEARD], "paths": PATHS, "sessions": SESSIONS}
    return json.dumps({"result": answers[request["command"]]}).encode() + b"\n"


@pytest.fixture
def console(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Answer]]:
    """A controller's socket where the verbs look for it; the test may change the answer."""
    monkeypatch.setattr(controller_console, "RUNTIME_ROOT", tmp_path)
    folder = tmp_path / str(this_process())
    folder.mkdir()
    answers: list[Answer] = [well]
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "console.sock"))
        listener.listen()

        def serve() -> None:
            while True:
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection:
                    connection.sendall(answers[0](json.loads(connection.recv(4096))))

        server = threading.Thread(target=serve)
        server.start()
        yield answers
        listener.shutdown(socket.SHUT_RDWR)
    server.join(SOON_S)


def lines(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines()]


@pytest.mark.usefixtures("console")
def test_devices_are_shown_in_tables(capsys: pytest.CaptureFixture[str]) -> None:
    devices.show(ask("devices"), as_json=False)
    shown = lines(capsys.readouterr().out)
    assert ["1", "q1-eth1", "up", "-", "-", "-", "-", "-", "-", "-", "-"] in shown
    assert [
        "2",
        "q1-eth2",
        "cut",
        "4,000",
        "10",
        "3",
        "193,400,000",
        "-1.5",
        "0.0",
        "-",
        "7",
    ] in shown
    words = "bob silent since 61 s store 4,000 measure bob-q0 (cut) 3 1 2 3,000 4 5 1,000 Hz, 64 B,"
    words += " FEC golay, interleaving on,"
    assert f"{words} 1,550,120 pm 1,000 Hz".split() in shown
    assert ["eve", "never", "heard", "unknown"] in shown


def test_what_a_host_has_no_number_of_is_not_shown() -> None:
    known = {"rate_hz": 1000, "frame_bytes": None, "fec": "none", "wavelength_pm": None}
    assert tables.settings(known) == "1,000 Hz, FEC none"
    assert tables.settings(dict.fromkeys(known)) == ""


@pytest.mark.usefixtures("console")
def test_paths_are_shown_by_the_names_of_switches(capsys: pytest.CaptureFixture[str]) -> None:
    light_paths.ask_and_show(as_json=False)
    shown = lines(capsys.readouterr().out)
    hops = "q1:2->7, 0000000000001002:1->3"
    assert f"07 alice bob charlie alice-q0 bob-q0 0.5 dB {hops}".split() in shown
    assert ["08,", "bob", "to", "alice:", "waits", "for", "light"] in shown
    assert ["q1:2", "alice-q0", "whole"] in shown
    assert ["q1:7", "0000000000001002:1", "cut"] in shown


@pytest.mark.usefixtures("console")
def test_json_is_all_that_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    light_paths.ask_and_show(as_json=True)
    assert json.loads(capsys.readouterr().out) == {**PATHS, "sessions": SESSIONS}
    devices.show(ask("devices"), as_json=True)
    assert json.loads(capsys.readouterr().out) == [SWITCH, HOST, UNHEARD]


def test_a_setting_is_asked_for_and_what_is_in_force_is_said(
    console: list[Answer], capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[dict[str, Any]] = []

    def answer(request: dict[str, Any]) -> bytes:
        asked.append(request)
        return b'{"result": {"overrides": {"frame_bytes": 64}}}\n'

    console[0] = answer
    set_host("alice", "frame-bytes", "64")
    set_host("alice", "rate-hz", "default")
    set_host("alice", "fec", "golay")
    set_host("alice", "interleave", "on")
    assert [request["settings"] for request in asked] == [
        {"frame_bytes": 64},
        {"rate_hz": None},
        {"fec": 3},
        {"interleave": 1},
    ]
    assert capsys.readouterr().out == "alice: overridden in new sessions: frame_bytes 64\n" * 4
    with pytest.raises(NoAnswer, match="fec is 'turbo': give one of none, repetition"):
        set_host("alice", "fec", "turbo")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b'{"error": "no device"}\n', "no device"),
        (b"", "the controller does not answer at"),
        (b"rubbish\n", "the controller does not answer at"),
    ],
)
def test_what_the_controller_refuses_or_mistells_is_said(
    console: list[Answer], text: bytes, words: str
) -> None:
    console[0] = lambda _request: text
    with pytest.raises(NoAnswer, match=words):
        ask("devices")


def test_folders_of_runs_that_have_ended_are_no_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller_console, "RUNTIME_ROOT", tmp_path)
    (tmp_path / "999999999").mkdir()
    (tmp_path / "lock").touch()
    with pytest.raises(
        NoAnswer, match="no network runs on this machine: start one, for example by `qmn cli"
    ):
        ask("devices")
