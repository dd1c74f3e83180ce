"""The console: what it is asked, and what it answers."""

import json
import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from controller_apps.console import console
from controller_apps.console.console import Console
from controller_apps.console.facts import Facts, perform
from controller_apps.console.questions import EventQuestion, Refused
from wire.controller_lines import MAX_REQUEST


class Known:
    """Facts that need no apps."""

    packages: Mapping[str, Any] = MappingProxyType({"keys": None})

    def devices(self) -> list[str]:
        return ["q1"]

    def set(self, device: str, settings: dict[str, int | None]) -> list[Any]:
        return [device, settings]

    sessions = paths = reload_policy = devices

    def of_package(self, name: str) -> list[str]:
        return [name]


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ([], "a request is an object"),
        ({}, "no command None: choose one of devices"),
        ({"command": ["devices"]}, "no command"),
        ({"command": "devices", "more": 1}, "devices takes nothing, not more"),
        ({"command": "set", "device": "alice"}, "set takes device, settings, not device"),
        ({"command": "set", "device": 1, "settings": {"fec": 0}}, "device 1 is not a name"),
        ({"command": "set", "device": "a", "settings": {}}, "settings are an object"),
        ({"command": "set", "device": "a", "settings": {"fec": 0.5}}, "fec is 0.5: give one"),
        ({"command": "set", "device": "a", "settings": {"fec": "x"}}, "or null to undo"),
        ({"command": "set", "device": "a", "settings": {"fec": True}}, "fec is True"),
    ],
)
def test_the_console_refuses_what_it_does_not_know(request_: Any, words: str) -> None:
    with pytest.raises(Refused) as caught:
        perform(Known(), request_)  # type: ignore[arg-type]
    assert words in str(caught.value)


def exchange(path: Path, sent: bytes) -> Any:
    """Send bytes and the end of them; return the decoded answer."""
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(5)
        client.connect(str(path))
        client.sendall(sent)
        client.shutdown(socket.SHUT_WR)
        return json.loads(b"".join(iter(lambda: client.recv(65536), b"")))


class Knowing:
    """An app that answers at once what it is asked."""

    def __init__(self, answer: Any) -> None:
        self.name, self._answer = "app", answer

    def send_event(self, _name: str, question: EventQuestion) -> None:
        """Answer."""
        question.answer(self._answer)


def test_devices_are_shown_with_what_they_have_announced() -> None:
    switch = {"name": "q1", "kind": "quantum-switch"}
    devices = [switch, *({"name": name, "kind": "host"} for name in ("alice", "bob"))]
    report = {"features": ["store"], "memory_qubits": 32}
    shown = Facts(Knowing({"alice": report}), Knowing(devices)).devices()
    assert shown == [
        switch,
        {"name": "alice", "kind": "host", **report},
        {"name": "bob", "kind": "host", "features": None, "memory_qubits": None},
    ]


def test_the_console_answers_lines_and_survives_rubbish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "REQUEST_TIMEOUT_S", 0.2)
    path = tmp_path / "console.sock"
    path.touch()  # left behind
    served = Console(str(path))
    assert path.stat().st_mode & 0o777 == 0o600
    threading.Thread(target=served.serve, args=[Known()], daemon=True).start()
    line = f"a request is one line of at most {MAX_REQUEST} bytes"
    assert exchange(path, b"\n")["error"].startswith("the request is not JSON")
    assert exchange(path, b"[" * 4000 + b"\n")["error"].startswith("the request is not JSON")
    assert exchange(path, b"x" * (MAX_REQUEST + 1) + b"\n") == {"error": line}
    assert exchange(path, b"{}") == {"error": line}
    with socket.socket(socket.AF_UNIX) as idle:  # says nothing, and must not block the next
        idle.connect(str(path))
        assert exchange(path, b'{"command": "devices"}\n') == {"result": ["q1"]}
    order: dict[str, Any] = {"command": "set", "device": "a", "settings": {"fec": None}}
    assert exchange(path, json.dumps(order).encode() + b"\n") == {"result": ["a", {"fec": None}]}
    order = {"command": "set", "device": "a", "settings": {"fec": "golay", "interleave": True}}
    numbers = {"fec": 3, "interleave": 1}
    assert exchange(path, json.dumps(order).encode() + b"\n") == {"result": ["a", numbers]}
