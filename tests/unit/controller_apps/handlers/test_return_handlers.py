"""Switches and controllers that come back: which entries stay, and what is kept."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import handlers_scene
import pytest
from handlers_scene import Datapath, Scene, flow_mods, grant, shift_clock
from metadata_scene import (
    ALICE,
    BOB,
    FRAMED,
    Q1,
    S1,
    frame,
    is_live,
    payload_of,
)

from controller_apps.openflow import flow_entries, framework
from controller_apps.openflow.framework import ofproto, parser
from controller_apps.packets import FiveTuple
from controller_apps.sessions.state_folder import StateFolder
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason

scene, ready = handlers_scene.scene, handlers_scene.ready  # fixtures


def stats(scene: Scene, *entries: tuple[int, int, int]) -> None:
    """Answer the question for entries: cookie, in_port and out_port of each."""
    (xid,) = (xid for dpid, xid in scene.quantum.switches._listed if dpid == scene.q1.id)
    for more, part in ((1, entries[:2]), (0, entries[2:])):
        body = [
            SimpleNamespace(
                cookie=cookie,
                priority=100 if cookie else 65000,
                match=parser.OFPMatch(in_port=in_port),
                instructions=[flow_entries.output(out_port)],
            )
            for cookie, in_port, out_port in part
        ]
        reply = SimpleNamespace(datapath=scene.q1, body=body, xid=xid, flags=more)
        scene.quantum.flows_listed(SimpleNamespace(msg=reply))


OWN = [(FRAMED.session, 4, 1), (FRAMED.session, 1, 3), (FRAMED.session, 5, 2)]


def test_paths_of_dead_sessions_are_deleted(ready: Scene) -> None:
    grant(ready)
    stats(ready, (0, 4, 1), *OWN, (99, 4, 1), (99, 1, 2), (98, 1, 2))
    deleted = ready.q1.take()
    assert [message.cookie for message in deleted] == [98, 99]
    assert all(message.cookie_mask == (1 << 64) - 1 for message in deleted)


def test_one_entry_of_a_live_session_is_deleted_by_all_that_identifies_it(ready: Scene) -> None:
    grant(ready)
    stats(ready, *OWN, (FRAMED.session, 2, 9))
    _opening, deletion, _commit, _barrier = ready.q1.take()
    entry = deletion.inner
    assert (entry.command, entry.priority) == (ofproto.OFPFC_DELETE_STRICT, 100)
    assert (entry.match["in_port"], entry.out_port) == (2, 9)
    assert (entry.cookie, entry.cookie_mask) == (FRAMED.session, (1 << 64) - 1)


def test_entries_that_somebody_else_asked_for_are_not_judged(ready: Scene) -> None:
    body = [SimpleNamespace(cookie=99, priority=100)]
    reply = SimpleNamespace(datapath=ready.q1, body=body, xid=1, flags=0)
    ready.quantum.flows_listed(SimpleNamespace(msg=reply))
    assert ready.q1.take() == []


def test_a_switch_that_stays_away_gets_nothing_and_ends_its_sessions(
    ready: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    grant(ready)
    ready.connect(ready.q1, framework.DEAD)
    assert ready.q1.take() == []
    assert is_live(ready.quantum.arbiter, FRAMED.session)
    other = replace(FRAMED, session=8)
    ready.packet_in(ready.s1, 1, frame(other.encode(), sport=41000))
    (sent,) = ready.s1.take()
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert answer.reason == Reason.PATH_BROKEN
    shift_clock(monkeypatch, 10.0)
    ready.quantum.time_passed(None)
    assert ready.q1.take() == []
    assert ready.recorded()[-1]["detail"] == "switch gone"


def test_a_switch_that_is_soon_back_keeps_its_sessions_and_gets_what_it_lost(ready: Scene) -> None:
    grant(ready)
    again = Datapath(Q1)
    ready.connect(again)
    ready.connect(ready.q1, framework.DEAD)  # noticed only now
    assert ready.quantum.switches.datapaths[Q1] is again
    ready.q1 = again
    ready.tell_optics(again)
    again.take()
    stats(ready, OWN[0], (99, 3, 4))
    messages = again.take()
    added = [m.inner for m in messages if m.kind == ofproto.OFPT_BUNDLE_ADD_MESSAGE]
    assert [(e.cookie, e.match["in_port"]) for e in added] == [(7, 1), (7, 5)]
    assert [m.cookie for m in flow_mods(messages)] == [99]
    assert is_live(ready.quantum.arbiter, FRAMED.session)


def test_a_connection_without_features_is_no_switch(ready: Scene) -> None:
    nobody = Datapath(0)
    nobody.id = None  # type: ignore[assignment]
    ready.connect(nobody, framework.DEAD)
    assert nobody.take() == []


def test_a_second_controller_begins_with_what_the_first_has_kept(tmp_path: Path) -> None:
    first = Scene(tmp_path, str(tmp_path / "state"))
    first.announce()
    grant(first)
    second = Scene(tmp_path, str(tmp_path / "state"))
    assert second.quantum.network.hosts == first.quantum.network.hosts
    assert is_live(second.quantum.arbiter, FRAMED.session)
    resumed = [fact for fact in second.recorded() if fact["event"] == "resumed"]
    assert [fact["session"] for fact in resumed] == [f"{FRAMED.session:016x}"]


def list_bypasses(scene: Scene, *entries: Any) -> None:
    """Answer the question for the entries of the classical switch."""
    (xid,) = (xid for dpid, xid in scene.quantum.switches._listed if dpid == S1)
    reply = SimpleNamespace(datapath=scene.s1, body=list(entries), xid=xid, flags=0)
    scene.quantum.flows_listed(SimpleNamespace(msg=reply))


def classical_entry(cookie: int, priority: int = 300, **match: Any) -> Any:
    fields = flow_entries._connection(FiveTuple(ALICE, 40000, BOB, METADATA_PORT)) | match
    return SimpleNamespace(
        cookie=cookie, priority=priority, match=parser.OFPMatch(**fields), instructions=[]
    )


def test_of_a_classical_switch_bypasses_of_live_sessions_stay(ready: Scene) -> None:
    grant(ready)
    ready.s1.take()
    list_bypasses(
        ready,
        classical_entry(FRAMED.session),
        classical_entry(0, priority=200),  # one of the standing entries
        classical_entry(99),
        classical_entry(FRAMED.session, tcp_src=40001),
        classical_entry(98, priority=500),  # somebody else's
    )
    deleted = ready.s1.take()
    assert [(m.cookie, m.priority, m.match["tcp_src"]) for m in deleted] == [
        (98, 500, 40000),
        (99, 300, 40000),
        (FRAMED.session, 300, 40001),
    ]
    assert all(m.command == ofproto.OFPFC_DELETE_STRICT for m in deleted)
    assert {m.cookie_mask for m in deleted} == {(1 << 64) - 1}
    assert ready.quantum.arbiter.sessions.by_number[FRAMED.session].bypassed


def test_no_entry_of_a_session_is_wiped(scene: Scene) -> None:
    wiped = [m for m in flow_mods(scene.s1.take()) if m.command == ofproto.OFPFC_DELETE]
    cookies = [(m.cookie, m.cookie_mask) for m in wiped if m.table_id == 1]
    assert cookies == [(0, (1 << 64) - 1)]


def test_what_was_kept_and_cannot_be_read_is_dropped(tmp_path: Path) -> None:
    state = StateFolder(str(tmp_path / "state"))
    first = Scene(tmp_path, str(tmp_path / "state"))
    first.announce()
    grant(first)
    ((_number, data),) = state.sessions()
    state.keep_session(8, data)  # another session's
    state.keep_session(9, data[:-1])
    state.keep_hosts(b"?")
    second = Scene(tmp_path, str(tmp_path / "state"))
    assert [number for number, _data in state.sessions()] == [FRAMED.session]
    assert list(second.quantum.arbiter.sessions.by_number) == [FRAMED.session]
    assert second.quantum.network.hosts == {}
