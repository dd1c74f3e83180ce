"""A set-up on its way: the bundle, the barrier, the packet that is let go, and refusals."""

import logging
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import handlers_scene
import pytest
from handlers_scene import UNFILTERED, Scene, announcement, instructions, shift_clock
from metadata_scene import (
    ALICE,
    BOB,
    FRAMED,
    MACS,
    S1,
    frame,
    payload_of,
)

from controller_apps.console.questions import EventQuestion
from controller_apps.light.paths import HostPort
from controller_apps.openflow.framework import ofproto, parser
from wire.metadata.decoding import decode
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Verdict

scene, ready = handlers_scene.scene, handlers_scene.ready  # fixtures


def test_a_bundle_is_open_adds_commit_barrier_in_one_write(ready: Scene) -> None:
    before = ready.q1.writes
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    assert ready.q1.writes == before + 1
    opening, *adds, commit, barrier = ready.q1.take()
    flags = ofproto.OFPBF_ATOMIC | ofproto.OFPBF_ORDERED
    assert (opening.type, commit.type) == (
        ofproto.OFPBCT_OPEN_REQUEST,
        ofproto.OFPBCT_COMMIT_REQUEST,
    )
    assert opening.flags == commit.flags == flags
    assert opening.bundle_id == commit.bundle_id
    assert barrier.kind == ofproto.OFPT_BARRIER_REQUEST
    entries = [add.inner for add in adds]
    paths = [(entry.match["in_port"], instructions(entry)) for entry in entries]
    assert paths == [(4, [("output", 1)]), (1, [("output", 3)]), (5, [("output", 2)])]
    for entry in entries:
        assert (entry.command, entry.table_id, entry.priority) == (ofproto.OFPFC_ADD, 0, 100)
        assert (entry.cookie, entry.flags) == (FRAMED.session, 0)
        assert (entry.idle_timeout, entry.hard_timeout) == (0, 0)
    assert len({message.xid for message in (opening, *adds, commit, barrier)}) == 6
    assert ready.s1.take() == []  # still held


def test_paced_no_message_has_the_next_look_computed(
    ready: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ready.quantum.arbiter, "next_slot_s", lambda _now: pytest.fail("computed"))
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    assert ready.quantum.arbiter.holds


def test_a_policy_that_is_read_again_puts_a_host_on_the_fibre(ready: Scene, tmp_path: Path) -> None:
    for number, port in enumerate((6, 7)):
        ready.packet_in(ready.q1, port, announcement(HostPort("eve", "10.0.0.4", f"eve-q{number}")))
    file = tmp_path / "policy.toml"
    file.write_text(UNFILTERED + "[[tap]]\nbetween = ['bob', 'charlie']\nby = 'eve'")
    ready.quantum.policy_path = str(file)
    question = EventQuestion("reload", {})
    ready.quantum.asked(question)
    assert question.wait() == str(file)
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    _opening, *adds, _commit, _barrier = ready.q1.take()
    paths = [(add.inner.match["in_port"], instructions(add.inner)[0][1]) for add in adds]
    assert paths == [(4, 1), (1, 3), (5, 6), (7, 2)]


def test_the_packet_leaves_by_the_learned_port_after_the_barrier(ready: Scene) -> None:
    ready.quantum.mac_table.learn(S1, bytes.fromhex(MACS[BOB].replace(":", "")), 6)
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    barrier = ready.q1.take()[-1]
    ready.barrier(barrier.xid)
    (sent,) = ready.s1.take()
    assert (sent.kind, sent.in_port, sent.port) == (ofproto.OFPT_PACKET_OUT, 1, 6)
    expected = replace(FRAMED, verdict=Verdict.GRANTED, rotation=2)
    assert decode(payload_of(sent.frame)) == expected
    assert not ready.quantum.switches._transactions
    events = [(line["event"], line.get("session")) for line in ready.recorded()]
    assert events[-2:] == [("path_ready", f"{7:016x}"), ("granted", f"{7:016x}")]
    ready_line, granted = ready.recorded()[-2:]
    asked = {name: granted[name] for name in ("service", "from", "to")}
    assert asked == {"service": "sdc", "from": "alice", "to": "bob"}
    ways = [(way["begin"], way["end"], way["by"], way["loss_db"]) for way in granted["light"]]
    assert ways == [
        ("charlie-q0", "alice-q0", ["q1"], 0.5),  # the switch's own description
        ("alice-q0", "bob-q1", ["q1"], 0.5),
        ("charlie-q1", "bob-q0", ["q1"], 0.5),
    ]
    assert ready_line["setup_ms"] > 0
    assert ready_line["packet_in_count"] == 1  # LLDP of the fibres is not


def test_a_policy_that_is_read_again_has_its_schedule(ready: Scene, tmp_path: Path) -> None:
    file = tmp_path / "policy.toml"
    file.write_text("[swap]\nschedule = 'nested'")
    ready.quantum.policy_path = str(file)
    ready.quantum.asked(EventQuestion("reload", {}))
    assert ready.quantum.arbiter.terms.policy.schedule == "nested"


def test_what_the_policy_denies_is_refused_and_opens_nothing(ready: Scene, tmp_path: Path) -> None:
    file = tmp_path / "policy.toml"
    file.write_text("default = 'deny'\n" + UNFILTERED)
    ready.quantum.policy_path = str(file)
    ready.quantum.asked(EventQuestion("reload", {}))
    ready.q1.take()
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    assert ready.q1.take() == []
    (sent,) = [message for message in ready.s1.take() if message.kind == ofproto.OFPT_PACKET_OUT]
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert (answer.verdict, answer.reason) == (Verdict.REFUSED, Reason.NOT_ALLOWED)
    fact = next(fact for fact in ready.recorded() if fact["event"] == "forbidden")
    assert (fact["service"], fact["from"], fact["to"]) == ("sdc", "alice", "bob")


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (FRAMED, "NOT_ALLOWED: alice to bob: no rule allows it, and the default denies"),
        (replace(FRAMED, source="10.0.0.99"), "UNKNOWN_HOST"),
    ],
    ids=["forbidden", "impossible"],
)
def test_who_asks_for_what_is_refused_without_end_leaves_room_in_the_log(
    ready: Scene,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    asked: Setup,
    why: str,
) -> None:
    """Five lines of each port, and a sixth that counts the others; the record has all."""
    shift_clock(monkeypatch, 0)  # it stands still
    if "NOT_ALLOWED" in why:
        file = tmp_path / "policy.toml"
        file.write_text("default = 'deny'\n" + UNFILTERED)
        ready.quantum.policy_path = str(file)
        ready.quantum.asked(EventQuestion("reload", {}))
    caplog.set_level(logging.INFO, logger=ready.quantum.logger.name)
    for number in range(20):
        setup = replace(asked, session=100 + number)
        ready.packet_in(ready.s1, 1, frame(setup.encode(), sport=41000 + number))
    back = frame(replace(asked, session=200).encode(), source=BOB, destination=ALICE)
    ready.packet_in(ready.s1, 2, back)
    assert caplog.messages == [
        *(f"session {100 + number:016x}: refused, {why}" for number in range(5)),
        f"session {200:016x}: refused, {why.replace('alice to bob', 'bob to alice')}",
    ]
    assert [fact["event"] for fact in ready.recorded()].count("refused") == 21
    shift_clock(monkeypatch, 1)
    ready.quantum.time_passed(None)
    assert caplog.messages[6:] == ["switch 0x1 port 1: 15 more lines, which are left out"]


def test_an_unknown_receiver_is_flooded(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, frame(replace(FRAMED, source="10.0.0.77").encode()))
    (sent,) = ready.s1.take()
    assert sent.port == ofproto.OFPP_FLOOD
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert answer.reason == Reason.UNKNOWN_HOST
    fact = ready.recorded()[-1]
    assert fact["event"] == "refused"
    assert (fact["service"], fact["from"]) == ("sdc", "alice")


@pytest.mark.parametrize("which", range(6))
def test_an_error_for_any_message_of_the_bundle_refuses(ready: Scene, which: int) -> None:
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    messages = ready.q1.take()
    failed = parser.OFPErrorMsg(ready.q1, ofproto.OFPET_FLOW_MOD_FAILED, 0, b"")
    failed.xid = messages[which].xid
    ready.quantum.switch_refused(SimpleNamespace(msg=failed))
    (deleted,) = ready.q1.take()
    assert (deleted.command, deleted.cookie) == (ofproto.OFPFC_DELETE, FRAMED.session)
    assert deleted.cookie_mask == (1 << 64) - 1
    (sent,) = ready.s1.take()
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert (answer.verdict, answer.reason) == (Verdict.REFUSED, Reason.SWITCH_FAILED)
    ready.barrier(messages[-1].xid)  # comes all the same
    assert ready.s1.take() == []
    assert not ready.quantum.switches._transactions


def test_an_error_of_something_else_refuses_nothing(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    ready.q1.take()
    other = parser.OFPErrorMsg(ready.q1, ofproto.OFPET_BAD_REQUEST, 0, b"")
    other.xid = 0x7FFFFFFF
    ready.quantum.switch_refused(SimpleNamespace(msg=other))
    assert ready.q1.take() == ready.s1.take() == []
