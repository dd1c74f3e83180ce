"""A live view of a network that runs: files as they are written, and a dispatcher that is gone."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any
from urllib.parse import unquote

import pytest
from limits import SOON_S, wait_until
from recorded_run import MS, NETWORK, START_NS

from dispatcher.layer.history import EventCapture
from views.events import event_sources
from views.live.handshakes import newest_photons
from views.live.sources import _follow_lines, following
from views.live.timeline import Timeline
from views.report.run_facts import SENDER_LOG
from wire.config import DispatcherConfig
from wire.controller_lines import RECORD
from wire.dispatcher_pb2 import BlockId
from wire.dispatcher_pb2 import Event as QuantumEvent

Write = Callable[[bytes], None]
NOW_NS = START_NS + 7 * MS


def events(timeline: Timeline) -> list[dict[str, Any]]:
    return [json.loads(text) for text in timeline.after(0, 1000)[0]]


def test_a_network_whose_dispatcher_does_not_answer_is_a_fault_and_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_sources, "WATCH_TIMEOUT_S", 0.05)
    timeline = Timeline(START_NS)
    nowhere = str(tmp_path / "nowhere")
    with following(timeline, DispatcherConfig("", nowhere, 1, {}, [], []), tmp_path):
        wait_until(lambda: timeline.ended, "the timeline has ended")
    (fault,) = (each for each in events(timeline) if each["what"] == "fault")
    assert fault["text"].startswith(f"the dispatcher at {nowhere} does not answer in 0.05 s")
    assert fault["t"] > 0  # of now


@pytest.fixture
def written(tmp_path: Path) -> Iterator[tuple[Timeline, Write]]:
    """Give what follows a file of lines: its timeline, and what appends to the file."""
    timeline, over, file = Timeline(START_NS), Event(), tmp_path / "lines"
    follow = Thread(target=_follow_lines, args=(timeline, "job", file, lambda: NOW_NS, over))
    follow.start()

    def write(data: bytes) -> None:
        with file.open("ab") as opened:
            opened.write(data)

    yield timeline, write
    over.set()
    follow.join(SOON_S)
    assert not follow.is_alive()


def test_lines_are_told_when_they_are_whole_and_once(
    written: tuple[Timeline, Write],
) -> None:
    timeline, write = written
    write(b'{"n": 1, "time_ns": %d}\n{"n"' % (START_NS + MS))
    wait_until(lambda: len(events(timeline)) > 0, "the first line")
    write(b': 2}\nrubbish\n{"n":')
    wait_until(lambda: len(events(timeline)) > 1, "the second line")
    write(b" 3}\n")
    wait_until(lambda: len(events(timeline)) > 2, "the last line")
    one = {"t": 1e-3, "what": "job", "n": 1}  # its time comes once
    assert events(timeline) == [one, *({"t": 7e-3, "what": "job", "n": n} for n in (2, 3))]


def test_records_of_the_controller_and_words_of_the_job_are_followed(tmp_path: Path) -> None:
    (tmp_path / RECORD).write_text('{"n": 1}\n')
    (tmp_path / SENDER_LOG).write_text('{"n": 2}\n')
    timeline = Timeline(START_NS)
    config = DispatcherConfig("", str(tmp_path / "nowhere"), 1, {}, [], [])
    with following(timeline, config, tmp_path):
        wait_until(lambda: len(events(timeline)) == 2, "both lines")
    assert {(each["what"], each["n"]) for each in events(timeline)} == {
        ("controller", 1),
        ("job", 2),
    }


def test_the_first_photons_are_of_the_newest_session_of_a_key(tmp_path: Path) -> None:
    """By hand: bob's basis is alice's in one of two photons; session 3 carries no key."""
    assert newest_photons(tmp_path) == ""
    with (tmp_path / "quantum.pcapng").open("wb") as opened:
        capture = EventCapture(opened, NETWORK.fibers)
        for session, state in ((1, "|0>"), (2, "|1>"), (3, "|+>")):
            block = BlockId(session=session)
            sent = QuantumEvent(node="alice", kind="create", block=block, first=[state, "|+>"])
            seen = QuantumEvent(node="bob", kind="measure", block=block, first=["Z 1", "Z 0"])
            capture.record(sent, seen)
    named = {"time_ns": START_NS, "event": "granted", "from": "alice", "to": "bob"}
    services = {1: "bb84", 2: "bb84", 3: "teleport", 4: "bb84"}  # of 4 no light has come
    facts = [{**named, "session": f"{n:016x}", "service": name} for n, name in services.items()]
    (tmp_path / RECORD).write_text("".join(json.dumps(fact) + "\n" for fact in facts))
    rows = unquote(newest_photons(tmp_path).split("data:text/csv,")[1].split('"')[0])
    assert rows.splitlines()[1:] == ["1,Z,1,Z,1,yes", "2,X,0,Z,0,"]
