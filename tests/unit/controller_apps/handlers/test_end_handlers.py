"""How sessions end: by a packet, by silence, by the deadline of a hold."""

import struct
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import handlers_scene
import pytest
from handlers_scene import (
    BROADCAST,
    ONE,
    Scene,
    ethernet,
    flow_mods,
    grant,
    instructions,
    shift_clock,
)
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FIBERS,
    FRAMED,
    HOLD_S,
    frame,
    is_live,
    payload_of,
)

from controller_apps.apps.host_commands import EventEstimate
from controller_apps.openflow.framework import ofproto, parser
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import Quantity, SessionEstimate

scene, ready = handlers_scene.scene, handlers_scene.ready  # fixtures


def test_later_data_installs_the_bypass_and_fin_removes_it(ready: Scene) -> None:
    grant(ready)
    ready.packet_in(ready.s1, 1, frame(b"later", seq=100 + SETUP_LENGTH))
    bypass, sent = ready.s1.take()
    connection = {
        "eth_type": 0x0800,
        "ip_proto": 6,
        "ipv4_src": ALICE,
        "ipv4_dst": BOB,
        "tcp_src": 40000,
        "tcp_dst": METADATA_PORT,
    }
    assert dict(bypass.match.items()) == connection
    assert (bypass.table_id, bypass.priority, bypass.cookie) == (1, 300, FRAMED.session)
    assert (bypass.idle_timeout, bypass.flags) == (30, ofproto.OFPFF_SEND_FLOW_REM)
    assert instructions(bypass) == [("goto", 2)]
    assert sent.frame == frame(b"later", seq=100 + SETUP_LENGTH)

    ready.packet_in(ready.s1, 1, frame(flags="FA", seq=105 + SETUP_LENGTH))
    (deleted,) = ready.s1.take()
    assert (deleted.command, deleted.priority) == (ofproto.OFPFC_DELETE_STRICT, 300)
    assert dict(deleted.match.items()) == connection
    assert (deleted.cookie, deleted.cookie_mask) == (FRAMED.session, (1 << 64) - 1)
    (dark,) = ready.q1.take()
    assert (dark.command, dark.cookie) == (ofproto.OFPFC_DELETE, FRAMED.session)
    assert dark.cookie_mask == (1 << 64) - 1
    assert ready.recorded()[-1]["event"] == "torn_down"


def test_a_close_far_on_is_held_against_the_count_of_its_bypass(
    ready: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    grant(ready)
    ready.packet_in(ready.s1, 1, frame(b"later", seq=100 + SETUP_LENGTH))
    far = 100 + SETUP_LENGTH + (3 << 20)
    ready.packet_in(ready.s1, 1, frame(flags="FA", seq=far))
    ready.s1.take()
    shift_clock(monkeypatch, 2)
    ready.quantum.time_passed(None)
    (question,) = ready.s1.take()
    assert question.multipart == ofproto.OFPMP_FLOW
    cookie_and_mask = struct.unpack_from("!QQ", question.body, 16)  # OpenFlow 1.4, 7.3.5.2
    assert cookie_and_mask == (FRAMED.session, (1 << 64) - 1)
    for xid, count in ((question.xid + 1, 4 << 20), (question.xid, 4 << 20)):
        assert is_live(ready.quantum.arbiter, FRAMED.session)
        counted = SimpleNamespace(byte_count=count)
        reply = SimpleNamespace(datapath=ready.s1, xid=xid, body=[counted], flags=0)
        ready.quantum.flows_listed(SimpleNamespace(msg=reply))
    assert not is_live(ready.quantum.arbiter, FRAMED.session)


def expire(scene: Scene, reason: int) -> None:
    match = parser.OFPMatch(
        eth_type=0x0800,
        ip_proto=6,
        ipv4_src=ALICE,
        ipv4_dst=BOB,
        tcp_src=40000,
        tcp_dst=METADATA_PORT,
    )
    message = SimpleNamespace(datapath=scene.s1, reason=reason, priority=300, match=match)
    scene.quantum.entry_removed(SimpleNamespace(msg=message))


def test_an_expired_bypass_tears_down(ready: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    grant(ready)
    ready.packet_in(ready.s1, 1, frame(b"later", seq=100 + SETUP_LENGTH))
    shift_clock(monkeypatch, 31.0)
    expire(ready, ofproto.OFPRR_DELETE)
    assert ready.q1.take() == []
    expire(ready, ofproto.OFPRR_IDLE_TIMEOUT)
    (dark,) = ready.q1.take()
    assert (dark.command, dark.cookie) == (ofproto.OFPFC_DELETE, FRAMED.session)


def test_the_deadline_of_the_hold(ready: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    ready.q1.take()
    ready.quantum.time_passed(None)
    assert flow_mods(ready.q1.take()) == ready.s1.take() == []
    shift_clock(monkeypatch, HOLD_S)
    ready.quantum.time_passed(None)
    (sent,) = ready.s1.take()
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert answer.reason == Reason.SWITCH_TIMEOUT
    dark = [message.command for message in flow_mods(ready.q1.take())]
    assert dark == [ofproto.OFPFC_DELETE]


def test_the_end_is_recorded_with_all_packets_counted(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, BROADCAST), table=2)
    ready.quantum.close()
    last = ready.recorded()[-1]
    assert (last["event"], last["packet_in_count"]) == ("stopped", 1)
    assert ready.quantum.journal.packet_ins == len(FIBERS) + 1  # LLDP, too


def test_what_an_end_has_found_out_is_recorded_also_when_the_session_is_over(
    ready: Scene,
) -> None:
    def estimates() -> list[dict[str, Any]]:
        return [fact for fact in ready.recorded() if fact["event"] == "estimate"]

    report = SessionEstimate(0, FRAMED.session, Quantity.FIDELITY, 0.9, 0.8, 0.95)
    ready.quantum.estimate_reported(EventEstimate("alice", ALICE, report))  # not yet a session
    grant(ready)
    ready.quantum.estimate_reported(
        EventEstimate("charlie", CHARLIE, report)
    )  # at none of its ends
    assert estimates() == []
    ready.quantum.estimate_reported(EventEstimate("alice", ALICE, report))
    ready.packet_in(ready.s1, 1, frame(seq=100 + len(FRAMED.encode()), flags="FA"))
    assert ready.recorded()[-1]["event"] == "torn_down"
    qber = replace(report, quantity=Quantity.QBER)
    ready.quantum.estimate_reported(EventEstimate("bob", BOB, qber))
    found = [(fact["session"], fact["host"], fact["quantity"]) for fact in estimates()]
    session = f"{FRAMED.session:016x}"
    assert found == [(session, "alice", "fidelity"), (session, "bob", "qber")]
    assert [estimates()[0][name] for name in ("value", "low", "high")] == [0.9, 0.8, 0.95]
