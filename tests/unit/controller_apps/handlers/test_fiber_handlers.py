"""Where fibres lead: LLDP of hosts and of switches, cuts, and what nobody may claim."""

import logging
import random
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import handlers_scene
import pytest
from handlers_scene import (
    Datapath,
    Scene,
    announcement,
    fiber_port,
    instructions,
    reconnect,
    shift_clock,
)
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FIBERS,
    MACS,
    Q1,
    frame,
)
from scapy.contrib.lldp import (
    LLDPDUChassisID,
    LLDPDUEndOfLLDPDU,
    LLDPDUPortID,
    LLDPDUTimeToLive,
)
from scapy.layers.l2 import Ether

from controller_apps.console.questions import EventQuestion
from controller_apps.light.optics import SwitchPort
from controller_apps.openflow import discovery, framework
from controller_apps.openflow.framework import ofproto
from wire.features import EVERYTHING, NodeFeatures
from wire.lldp import OUI
from wire.lldp import announcement as host_announcement
from wire.malformed import MalformedPacket

KEY, OTHER_KEY = "0011", "2233"  # of bob and charlie

scene, ready = handlers_scene.scene, handlers_scene.ready  # fixtures


FORGED = {
    "in another's name, unsealed": ({"key": ""}, "without its seal"),
    "under the key of the one who lies": ({"key": OTHER_KEY}, "seal of an announcement is wrong"),
    "with the address of another": ({"address": CHARLIE}, "which is not its own"),
    "in a name that nobody has": ({"name": "mallory", "key": ""}, "address 10.0.0.2 of another"),
    "that was heard before": ({"number": 5}, "heard before"),
}


@pytest.mark.parametrize(("lie", "words"), FORGED.values(), ids=FORGED)
def test_nobody_announces_the_fibre_of_another(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, lie: dict[str, Any], words: str
) -> None:
    scene = Scene(tmp_path, keys={"bob": KEY, "charlie": OTHER_KEY})
    reports: dict[str, Any] = {
        "name": "bob",
        "port": "bob-q0",
        "address": BOB,
        "mac": bytes(6),
        "ttl_s": 30,
    }
    reports |= {"node_features": NodeFeatures(EVERYTHING, 8), "key": KEY, "number": 5}
    scene.packet_in(scene.q1, 2, host_announcement(**reports))
    at = SwitchPort(Q1, 2)
    assert set(scene.quantum.network.hosts) == {at}
    with caplog.at_level("INFO", scene.quantum.logger.name):
        scene.packet_in(scene.q1, 4, host_announcement(**{**reports, "number": 6, **lie}))
    assert words in caplog.text
    assert set(scene.quantum.network.hosts) == {at}
    scene.quantum.fibers.needs_seal = False  # for attack studies: all are believed
    scene.packet_in(scene.q1, 9, host_announcement(**{**reports, "number": 6, **lie}))
    assert SwitchPort(Q1, 9) in scene.quantum.network.hosts
    scene.quantum.fibers.needs_seal = True
    scene.packet_in(scene.q1, 4, host_announcement(**{**reports, "number": 7}))
    assert SwitchPort(Q1, 4) in scene.quantum.network.hosts


def test_a_policy_that_is_read_again_closes_fibres_and_believes_who_has_no_seal(
    tmp_path: Path,
) -> None:
    scene = Scene(tmp_path)
    quantum = scene.quantum
    quantum.network.names[Q1 + 1] = "q2"
    text = '[[closed]]\nbetween = ["q1", "q2"]\n[filter]\nannouncements = false\n'
    fiber = frozenset({"q1", "q2"})
    for policy, closed, sealed in ((text, [fiber], False), ("", [], True)):
        scene.policy_path.write_text(policy)
        question = EventQuestion("reload", {})
        quantum.asked(question)
        assert question.wait() == str(scene.policy_path)
        assert [*quantum.network.closed] == closed
        assert quantum.fibers.needs_seal is sealed


def test_fibres_of_a_quantum_switch_are_dark_but_for_lldp(scene: Scene) -> None:
    wiped, miss, entry, *questions = scene.q1.take()
    assert (wiped.table_id, miss.table_id) == (2, 2)
    assert entry.table_id == 0
    assert dict(entry.match.items()) == {"eth_type": 0x88CC}
    assert instructions(entry) == [("output", ofproto.OFPP_CONTROLLER)]
    asked = [question.multipart for question in questions]
    assert asked == [ofproto.OFPMP_FLOW, ofproto.OFPMP_EXPERIMENTER, ofproto.OFPMP_PORT_STATS]


def test_lldp_tells_where_hosts_are(ready: Scene) -> None:
    assert set(ready.quantum.network.hosts.values()) == set(FIBERS.values())
    ready.packet_in(ready.q1, 1, announcement(FIBERS[1], ttl=0))
    assert ready.quantum.network.ports_of(ALICE) == []


def test_fibres_are_cut_and_mended_as_their_ports_go_down_and_up(ready: Scene) -> None:
    def port(number: int, config: int = 0, state: int = 0) -> Any:
        return SimpleNamespace(
            port_no=number, config=config, state=state, properties=[], hw_addr=MACS[ALICE]
        )

    def status(desc: Any, datapath: Datapath = ready.q1) -> None:
        message = SimpleNamespace(datapath=datapath, desc=desc, reason=ofproto.OFPPR_MODIFY)
        ready.quantum.port_changed(SimpleNamespace(msg=message))

    cut = ready.quantum.network.cut
    status(port(1, config=ofproto.OFPPC_PORT_DOWN))
    status(port(2, state=ofproto.OFPPS_LINK_DOWN), ready.s1)
    assert cut == {(Q1, 1)}
    status(port(1, state=ofproto.OFPPS_LIVE))
    assert cut == set()
    ready.connect(ready.q1, framework.DEAD)
    local = port(ofproto.OFPP_LOCAL, config=ofproto.OFPPC_PORT_DOWN)
    ready.q1.ports = {3: port(3, state=ofproto.OFPPS_LINK_DOWN), ofproto.OFPP_LOCAL: local}
    ready.connect(ready.q1)
    assert cut == {(Q1, 3)}
    reports = [(fact["at"], fact["up"]) for fact in ready.recorded() if fact["event"] == "port"]
    assert reports == [(1, False), (1, True), (3, False)]


def spoken(messages: list[Any]) -> dict[int, bytes]:
    """Return the frames sent out, by port."""
    return {m.port: m.frame for m in messages if m.kind == ofproto.OFPT_PACKET_OUT}


def second_switch(scene: Scene, *ports: int) -> Datapath:
    """Connect a further quantum switch with fibres at the given ports."""
    scene.quantum.switches.quantum |= {Q1 + 1}
    q2 = Datapath(Q1 + 1)
    q2.ports = {number: fiber_port(number) for number in ports}
    scene.connect(q2)
    scene.tell_optics(q2)
    return q2


def test_lldp_goes_out_of_fibres_that_are_up_as_the_framework_writes_it(scene: Scene) -> None:
    q1 = reconnect(scene, fiber_port(1), fiber_port(2, up=False), fiber_port(9, None))
    scene.quantum.time_passed(None)
    ((port, frame_out),) = spoken(q1.take()).items()
    assert port == 1
    topology = framework._load("topology.switches")
    assert topology.LLDPPacket.lldp_parse(frame_out) == (Q1, 1)
    assert frame_out[6:12] == bytes([2, 0, 0, 0, 9, 1])


def test_without_optical_ports_every_port_may_be_a_fibre(scene: Scene) -> None:
    q1 = reconnect(scene, fiber_port(1, None), fiber_port(9, None))
    scene.quantum.time_passed(None)
    assert spoken(q1.take()).keys() == {1, 9}


def test_a_fibre_between_switches_is_found_cut_and_found_again(scene: Scene) -> None:
    q1, q2 = reconnect(scene, fiber_port(6)), second_switch(scene, 7)
    scene.quantum.time_passed(None)
    one, other = spoken(q1.take())[6], spoken(q2.take())[7]
    links = scene.quantum.network.links

    def hear_each_other() -> None:
        scene.packet_in(q2, 7, one)
        scene.packet_in(q1, 6, other)

    hear_each_other()
    assert links == {(Q1, 6): (Q1 + 1, 7), (Q1 + 1, 7): (Q1, 6)}
    assert [fact["ends"] for fact in scene.recorded() if fact["event"] == "link"] == [
        [[Q1, 6], [Q1 + 1, 7]]
    ]
    down = SimpleNamespace(datapath=q1, desc=fiber_port(6, up=False), reason=ofproto.OFPPR_MODIFY)
    scene.quantum.port_changed(SimpleNamespace(msg=down))
    assert links == {}
    hear_each_other()  # what was still on its way
    assert links == {}
    up = SimpleNamespace(datapath=q1, desc=fiber_port(6), reason=ofproto.OFPPR_MODIFY)
    scene.quantum.port_changed(SimpleNamespace(msg=up))
    hear_each_other()
    assert len(links) == 2
    gone = SimpleNamespace(datapath=q2, desc=fiber_port(7), reason=ofproto.OFPPR_DELETE)
    scene.quantum.port_changed(SimpleNamespace(msg=gone))
    assert links == {}


def test_a_host_cannot_claim_a_fibre_between_switches(scene: Scene) -> None:
    q1, q2 = reconnect(scene, fiber_port(6), fiber_port(8)), second_switch(scene, 7)
    scene.quantum.time_passed(None)
    genuine = spoken(q1.take())[6]
    draw = random.Random(3)
    forged = [
        discovery.switch_message(SwitchPort(Q1, 6), bytes(6), b"a guess"),
        genuine.replace(b"dpid:%016x" % Q1, b"dpid:%016x" % (Q1 + 1)),
        genuine.replace(b"dpid:%016x" % Q1, b"dpid:%016x" % (1 << 63)),
        genuine.replace(struct.pack("!I", 6), struct.pack("!I", 8)),
    ]
    for _ in range(3000):
        data = bytearray(genuine)
        data[draw.randrange(14, len(data))] ^= 1 << draw.randrange(8)
        forged.append(bytes(data[: draw.randrange(14, len(data) + 1)]))
    heard = scene.quantum.fibers._links._heard
    for attempt in forged[:4]:  # made up, or of another port than its seal
        scene.packet_in(q2, 7, attempt)
        assert heard == {}
    for attempt in forged[4:]:
        scene.packet_in(q2, 7, attempt)
        # A changed bit leaves no more whole than (Q1, 6) has announced.
        assert {each.speaker for each in heard.values()} <= {SwitchPort(Q1, 6)}
    assert scene.quantum.network.links == {}
    assert scene.quantum.journal.dropped["lldp"] > 1000
    stock = genuine[: genuine.index(OUI) - 2] + b"\0\0"
    before = scene.quantum.journal.dropped["lldp"]
    scene.packet_in(q2, 7, stock)  # another controller's: neither believed nor complained of
    assert scene.quantum.journal.dropped["lldp"] == before


def test_malformed_lldp_is_counted_and_changes_nothing(scene: Scene) -> None:
    good = announcement(FIBERS[1])
    no_address = bytes(
        Ether(dst="01:80:c2:00:00:0e", type=0x88CC)
        / LLDPDUChassisID(subtype=7, id="alice")
        / LLDPDUPortID(subtype=7, id="alice-q0")
        / LLDPDUTimeToLive(ttl=9)
        / LLDPDUEndOfLLDPDU()
    )
    odd_name = announcement(replace(FIBERS[1], host="al\x07ice"))
    mac_address = announcement(FIBERS[1], subtype=6)
    end = good.index(b"\x0c\x05") + 15  # of the last TLV; the rest is padding
    assert discovery.parse(good[:end]) == discovery.Announcement(FIBERS[1], leaving=False)
    rubbish = [good[:length] for length in range(14, end)]
    rubbish += [no_address, odd_name, mac_address, good[:14] + b"\xff" * 40]
    for data in rubbish:
        with pytest.raises(MalformedPacket):
            discovery.parse(data)
        scene.packet_in(scene.q1, 1, data)
    assert scene.quantum.journal.dropped["lldp"] == len(rubbish)
    assert not scene.quantum.network.hosts


def test_who_floods_a_port_leaves_room_in_the_log_for_others(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    shift_clock(monkeypatch, 0)  # it stands still
    caplog.set_level(logging.INFO, logger=scene.quantum.logger.name)
    for _ in range(1000):
        scene.packet_in(scene.q1, 1, b"\xff" * 40)
    scene.packet_in(scene.q1, 2, b"\xff" * 40)
    scene.packet_in(scene.s1, 1, frame(b"no magic"))
    lines = [line for line in caplog.messages if line.startswith("dropped (")]
    assert [line.split(": ")[1] for line in lines] == [
        *["switch 0x2 port 1"] * 5,
        "switch 0x2 port 2",
        "switch 0x1 port 1",
    ]
    assert scene.quantum.journal.dropped == {"lldp": 1001, "malformed": 1}
    shift_clock(monkeypatch, 1)
    scene.quantum.time_passed(None)
    assert caplog.messages[-1] == "switch 0x2 port 1: 995 more lines, which are left out"


def test_hosts_say_what_they_can_do_or_what_they_say_is_not_heard(scene: Scene) -> None:
    able = replace(FIBERS[1], node_features=NodeFeatures(EVERYTHING, 32))
    data = announcement(able)
    assert discovery.parse(data) == discovery.Announcement(able, leaving=False)
    report = able.node_features.encode() if able.node_features else b""
    refused = [report[:length] for length in range(len(report))]
    refused += [report + b"\0", b"\xff" + report[1:], b"\x02" + bytes(4), b"\x0d" + report[1:]]
    for number, info in enumerate(refused, 1):
        wrong = announcement(FIBERS[1], report=(info,))
        with pytest.raises(MalformedPacket):
            discovery.parse(wrong)
        scene.packet_in(scene.q1, 1, wrong)
        assert scene.quantum.journal.dropped["lldp"] == number
    with pytest.raises(MalformedPacket, match="tells 2 times"):
        discovery.parse(announcement(FIBERS[1], report=(report, report)))
    assert not scene.quantum.network.hosts
    scene.packet_in(scene.q1, 1, data)
    assert scene.quantum.network.node_features_of(able.address) == able.node_features
    question = EventQuestion("node_features", {})
    scene.quantum.asked(question)
    features = ["emit", "store", "gate", "measure", "herald", "interfere", "absorb"]
    assert question.wait() == {"alice": {"features": features, "memory_qubits": 32}}
