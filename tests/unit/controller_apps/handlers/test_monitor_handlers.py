"""Idle light that the controller watches, through its app: orders out, the record, alarms."""

import logging
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import handlers_scene
import pytest
from handlers_scene import UNFILTERED, Scene
from metadata_scene import ALICE, BOB, FRAMED, S1, frame, payload_of

from controller_apps.apps.host_commands import EventAlarm, EventMonitorOver, EventNodeAnswered
from controller_apps.console.questions import EventQuestion
from controller_apps.devices.hosts_state import Place
from controller_apps.openflow.framework import ofproto
from controller_apps.packets import FiveTuple
from controller_apps.timeouts import DISCOVERY_S
from wire.device import DeviceReport
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

scene, ready = handlers_scene.scene, handlers_scene.ready  # fixtures

WATCH = """default = "deny"
[seal]
alarm = "close"
[[watch]]
between = ["alice", "bob"]
"""


def watching(ready: Scene, file: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any]]:
    """Have the policy watch; return what is sent to other apps."""
    sent: list[tuple[str, Any]] = []
    monkeypatch.setattr(ready.quantum, "send_event", lambda app, event: sent.append((app, event)))
    file.write_text(WATCH + UNFILTERED)
    ready.quantum.policy_path = str(file)
    ready.quantum.asked(EventQuestion("reload", {}))
    ready.s1.take()
    ready.quantum.watch_goes_on(None)
    return sent


def last(ready: Scene, event: str) -> dict[str, Any]:
    return next(fact for fact in reversed(ready.recorded()) if fact["event"] == event)


def test_a_seal_is_begun_by_the_policy_and_what_it_finds_recorded(
    ready: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = watching(ready, tmp_path / "policy.toml", monkeypatch)
    ((app, event),) = sent
    number = event.command.message.monitor
    assert (app, event.command.node) == ("DeviceMonitor", BOB)
    assert last(ready, "watch")["session"] == f"{number:016x}"
    ready.quantum.node_answered(EventNodeAnswered(number, BOB, Reason.OK))
    assert sent[-1][1].command.node == ALICE

    seal = replace(FRAMED, service=Service["SEAL"], source=ALICE, session=number)
    ready.packet_in(ready.s1, 1, frame(seal.encode()))
    barrier = ready.q1.take()[-1]
    ready.barrier(barrier.xid)
    (let_on,) = (each for each in ready.s1.take() if each.kind == ofproto.OFPT_PACKET_OUT)
    answer = decode(payload_of(let_on.frame))
    assert isinstance(answer, Setup)
    assert answer.verdict == Verdict.GRANTED  # though all else is denied

    connection = FiveTuple(ALICE, 40000, BOB, METADATA_PORT)
    assert ready.quantum.idle.ordered(seal, connection)
    fin = frame(sport=40000, seq=100 + len(seal.encode()), flags="FA")
    ready.packet_in(ready.s1, 1, fin)
    assert last(ready, "torn_down")["detail"] == "FIN"
    assert not ready.quantum.idle.ordered(seal, connection)

    report = DeviceReport(
        0, monitor=number, monitor_compared=2010, monitor_errors=3, monitor_tests=9
    )
    ready.quantum.monitor_over(EventMonitorOver("bob", BOB, report))  # who has not opened it
    assert "watched" not in [fact["event"] for fact in ready.recorded()]
    ready.quantum.monitor_over(EventMonitorOver("alice", ALICE, report))
    fact = last(ready, "watched")
    assert (fact["host"], fact["compared"], fact["errors"]) == ("alice", 2010, 3)
    assert (fact["tests_whole"], fact["alarm"], fact["end"]) == (9, False, "OK")


def test_a_seal_that_nobody_ordered_needs_leave_as_any_session(
    ready: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watching(ready, tmp_path / "policy.toml", monkeypatch)
    ready.packet_in(
        ready.s1, 1, frame(replace(FRAMED, service=Service["SEAL"], source=ALICE).encode())
    )
    assert last(ready, "refused")["detail"].startswith("NOT_ALLOWED: alice to bob: ")


def test_an_alarm_of_a_seal_whose_light_was_taken_says_nothing(
    ready: Scene,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Its last photons may have gone by another path than its receiver knows."""
    now = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], time_ns=lambda: 1)
    for module in ("controller_apps.apps.quantum_metadata", "wire.network_time"):
        monkeypatch.setattr(f"{module}.time", clock)
    file = tmp_path / "policy.toml"
    file.write_text('[seal]\nalarm = "close"\n' + UNFILTERED)
    ready.quantum.policy_path = str(file)
    ready.quantum.asked(EventQuestion("reload", {}))
    seal = replace(FRAMED, service=Service["SEAL"], source=ALICE)
    ready.packet_in(ready.s1, 1, frame(seal.encode()))
    ready.barrier(ready.q1.take()[-1].xid)
    assert ready.quantum.monitors.is_of(seal.session, ALICE)
    wanted = replace(FRAMED, service=Service["BB84"], session=8)
    ready.packet_in(ready.s1, 1, frame(wanted.encode(), sport=40001))
    now[0] += 1.0
    ready.quantum.time_passed(None)
    assert last(ready, "torn_down")["detail"] == "a session wants its light"
    assert not ready.quantum.monitors.is_of(seal.session, ALICE)
    place = Place(S1, 1, b"", ALICE)
    ready.quantum.monitor_alarmed(EventAlarm(seal.session, "alice", place))
    assert last(ready, "alarm")["closed"] is False
    alarm = f"alice: alarm of its link monitor {seal.session:016x} on []"
    caplog.clear()
    caplog.set_level(logging.INFO, logger=ready.quantum.logger.name)
    for _ in range(20):  # its host may repeat itself, and each time it is recorded
        ready.quantum.monitor_alarmed(EventAlarm(seal.session, "alice", place))
    assert caplog.messages == [alarm] * 4
    now[0] += 1.0
    ready.quantum.time_passed(None)
    assert caplog.messages[4:] == ["switch 0x1 port 1: 16 more lines, which are left out"]
    assert [fact["event"] for fact in ready.recorded()].count("alarm") == 21


def test_why_a_way_is_not_watched_is_recorded_of_no_session(
    ready: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now[0], time_ns=lambda: 1)
    for module in ("controller_apps.apps.quantum_metadata", "wire.network_time"):
        monkeypatch.setattr(f"{module}.time", clock)
    file = tmp_path / "policy.toml"
    file.write_text('[[watch]]\nbetween = ["alice", "zoe"]\n' + UNFILTERED)
    ready.quantum.policy_path = str(file)
    ready.quantum.asked(EventQuestion("reload", {}))
    for _look in range(2):
        ready.quantum.watch_goes_on(None)
        now[0] += DISCOVERY_S
    fact = last(ready, "unwatched")
    assert fact["detail"] == "alice to zoe: zoe has announced no fibre"
    assert "session" not in fact
