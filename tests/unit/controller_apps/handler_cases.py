"""The apps' handlers with a datapath that records what it is sent.

test_controller_handlers.py runs this once for each framework: a process loads only one.
Messages are encoded by the framework and read back with its own parser where it can.
"""

import json
import random
import struct
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FIBERS,
    FRAMED,
    HOLD_S,
    MACS,
    Q1,
    S1,
    frame,
    payload_of,
)
from scapy.contrib.lldp import (
    LLDPDUChassisID,
    LLDPDUEndOfLLDPDU,
    LLDPDUGenericOrganisationSpecific,
    LLDPDUManagementAddress,
    LLDPDUPortID,
    LLDPDUTimeToLive,
)
from scapy.layers.l2 import Ether

from controller_apps.apps.learning_switch import LearningSwitch
from controller_apps.apps.quantum_metadata import QuantumMetadata
from controller_apps.apps.swap_orders import EventNodeAnswered
from controller_apps.console.questions import EventQuestion
from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import HostPort
from controller_apps.openflow import discovery, flow_entries, framework
from controller_apps.openflow.framework import ProtocolDesc, ofp_event, ofproto, parser
from controller_apps.openflow.mac_table import MacTable
from controller_apps.packets.segments import FiveTuple
from controller_apps.record import Record
from controller_apps.sessions.state_folder import StateFolder
from hosts.hardware.lldp import announcement as host_announcement
from wire.config import ControllerConfig, Station
from wire.device import DEVICE_PORT
from wire.features import EVERYTHING, OUI, SUBTYPE, Abilities
from wire.metadata import (
    METADATA_PORT,
    SETUP_LENGTH,
    MalformedPacket,
    Reason,
    Service,
    Setup,
    Verdict,
    decode,
)
from wire.optical import (
    ALL_VALID,
    ANY_PORT,
    EXPERIMENTER,
    PATH_OPTICS,
    RX_TUNE,
    TUNABLE,
    TX_TUNE,
    USE_FREQ,
    PathOptics,
    PortLight,
    PortOptics,
    PortTuning,
    encode_path_optics,
)


class Datapath(ProtocolDesc):  # type: ignore[misc]
    """A switch that keeps the messages it gets, as decoded from their bytes."""

    def __init__(self, dpid: int) -> None:
        super().__init__(ofproto.OFP_VERSION)
        self.id = dpid
        self.ports: dict[int, Any] = {}
        self.sent: list[Any] = []
        self.writes = 0
        self._xid = 1 << 31

    def set_xid(self, message: Any) -> int:
        self._xid += 1
        message.set_xid(self._xid)
        return self._xid

    def send_msg(self, message: Any) -> bool:
        if message.xid is None:
            self.set_xid(message)
        message.serialize()
        return self.send(message.buf)

    def send(self, data: bytes, close_socket: bool = False) -> bool:
        self.writes += 1
        data = bytes(data)
        while data:
            length = int.from_bytes(data[2:4], "big")
            self.sent.append(self._decode(data[:length]))
            data = data[length:]
        return True

    def _decode(self, data: bytes) -> Any:
        kind, xid = data[1], int.from_bytes(data[4:8], "big")
        decoders: dict[int, Any] = {
            ofproto.OFPT_FLOW_MOD: parser.OFPFlowMod,
            ofproto.OFPT_BUNDLE_CONTROL: parser.OFPBundleCtrlMsg,
            ofproto.OFPT_BARRIER_REQUEST: parser.OFPBarrierRequest,
        }
        if kind == ofproto.OFPT_BUNDLE_ADD_MESSAGE:
            inner = self._decode(data[16:])
            assert inner.xid == xid
            return SimpleNamespace(kind=kind, xid=xid, inner=inner)
        if kind == ofproto.OFPT_PACKET_OUT:
            return packet_out(data, xid)
        if kind == ofproto.OFPT_MULTIPART_REQUEST:
            multipart = int.from_bytes(data[8:10], "big")
            return SimpleNamespace(kind=kind, xid=xid, multipart=multipart, body=data[16:])
        if kind == ofproto.OFPT_PORT_MOD:
            return SimpleNamespace(kind=kind, xid=xid, data=data)
        if kind not in decoders:
            return SimpleNamespace(kind=kind, xid=xid)
        message = decoders[kind].parser(self, data[0], kind, len(data), xid, bytearray(data))
        message.kind = kind
        return message

    def take(self) -> list[Any]:
        """Return what was sent since the last call."""
        sent, self.sent = self.sent, []
        return sent


def packet_out(data: bytes, xid: int) -> SimpleNamespace:
    """Read what the frameworks cannot: OFPT_PACKET_OUT, OpenFlow 1.4 section 7.3.6."""
    actions_length = int.from_bytes(data[16:18], "big")
    action = parser.OFPActionOutput.parser(bytearray(data), 24)
    frame_begin = 24 + actions_length
    return SimpleNamespace(
        kind=ofproto.OFPT_PACKET_OUT,
        xid=xid,
        in_port=int.from_bytes(data[12:16], "big"),
        port=action.port,
        frame=data[frame_begin:],
    )


UNFILTERED = "[filter]\naddresses = false\nhandshakes = false\n"
STATIONS = [Station(S1, 1, MACS[ALICE], ALICE), Station(77, 1, MACS[BOB], BOB)]


class Scene:
    """Both apps, a classical and a quantum switch, all fibres announced."""

    def __init__(
        self,
        folder: Path,
        state: str = "",
        policy: str = UNFILTERED,
        keys: dict[str, str] | None = None,
    ) -> None:
        self.record_path, self.policy_path = folder / "record.jsonl", folder / "policy.toml"
        self.policy_path.write_text(policy)
        config = ControllerConfig(
            "127.0.0.1:6653",
            framework.NAME,
            [Q1],
            HOLD_S,
            30,
            str(self.record_path),
            policy=str(self.policy_path),
            stations=STATIONS,
            device_keys=keys or {},
            addresses={name: {"bob": BOB, "charlie": CHARLIE}[name] for name in keys or {}},
        )
        mac_table, record = MacTable(), Record(str(self.record_path))
        self.learning = LearningSwitch(mac_table, record=record)
        self.quantum = QuantumMetadata(config, mac_table, record, StateFolder(state))
        self.s1, self.q1 = Datapath(S1), Datapath(Q1)
        self.connect(self.s1)
        self.connect(self.q1)
        self.tell_optics(self.q1, PathOptics(ANY_PORT, ANY_PORT, 500, 2))

    def connect(self, datapath: Datapath, state: str = framework.MAIN) -> None:
        event = SimpleNamespace(datapath=datapath, state=state)
        self.learning.switch_changed(event)
        self.quantum.switch_changed(event)

    def tell_optics(self, datapath: Datapath, *paths: PathOptics, more: bool = False) -> None:
        """Answer the last question about optics, as the framework decodes it."""
        body = struct.pack("!II", EXPERIMENTER, PATH_OPTICS) + encode_path_optics(paths)
        reply = self.reply(datapath, asked_optics(datapath), ofproto.OFPMP_EXPERIMENTER, body, more)
        self.quantum.optics_told(SimpleNamespace(msg=reply))

    def measure(self, datapath: Datapath, port: int, light: PortLight) -> None:
        """Tell the statistics of a port."""
        prop = light.encode()
        body = struct.pack("!H2xI", 80 + len(prop), port) + bytes(72) + prop
        reply = self.reply(datapath, 1, ofproto.OFPMP_PORT_STATS, body)
        self.quantum.ports_measured(SimpleNamespace(msg=reply))

    def reply(
        self, datapath: Datapath, xid: int, kind: int, body: bytes, more: bool = False
    ) -> Any:
        """Return a multipart reply as the framework decodes it from bytes."""
        header = (5, ofproto.OFPT_MULTIPART_REPLY, 16 + len(body), xid)
        raw = struct.pack("!BBHIHH4x", *header, kind, more) + body
        return parser.OFPMultipartReply.parser(datapath, *header, bytearray(raw))

    def packet_in(self, datapath: Datapath, port: int, data: bytes, table: int = 1) -> None:
        message = parser.OFPPacketIn(
            datapath,
            buffer_id=ofproto.OFP_NO_BUFFER,
            table_id=table,
            match=parser.OFPMatch(in_port=port),
            data=data,
        )
        event = ofp_event.EventOFPPacketIn(message)
        self.learning.packet_arrived(event)
        self.quantum.packet_arrived(event)

    def announce(self) -> None:
        for port, host_port in FIBERS.items():
            self.packet_in(self.q1, port, announcement(host_port))
        self.s1.take()
        self.q1.take()

    def barrier(self, xid: int) -> None:
        reply = SimpleNamespace(datapath=self.q1, xid=xid)
        self.quantum.barrier_passed(SimpleNamespace(msg=reply))

    def recorded(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.record_path.read_text().splitlines()]


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


@pytest.fixture
def ready(scene: Scene) -> Scene:
    scene.announce()
    return scene


def asked_optics(datapath: Datapath) -> int:
    """Return the transaction id of the last question for optics."""
    kind = ofproto.OFPMP_EXPERIMENTER
    return int([m.xid for m in datapath.sent if getattr(m, "multipart", None) == kind][-1])


KEY, OTHER_KEY = "0011", "2233"  # of bob and charlie
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
    told: dict[str, Any] = {
        "name": "bob",
        "port": "bob-q0",
        "address": BOB,
        "mac": bytes(6),
        "ttl_s": 30,
    }
    told |= {"abilities": Abilities(EVERYTHING, 8), "key": KEY, "number": 5}
    scene.packet_in(scene.q1, 2, host_announcement(**told))
    at = SwitchPort(Q1, 2)
    assert set(scene.quantum.network.hosts) == {at}
    with caplog.at_level("INFO"):
        scene.packet_in(scene.q1, 4, host_announcement(**{**told, "number": 6, **lie}))
    assert words in caplog.text
    assert set(scene.quantum.network.hosts) == {at}
    scene.packet_in(scene.q1, 4, host_announcement(**{**told, "number": 7}))
    assert SwitchPort(Q1, 4) in scene.quantum.network.hosts


def announcement(
    host_port: HostPort, ttl: int = 120, subtype: int = 7, told: tuple[bytes, ...] = ()
) -> bytes:
    """Return an announcement; `told` are what TLVs of abilities hold, if not the port's own."""
    abilities = (host_port.abilities.encode(),) if host_port.abilities else told
    address = bytes(int(part) for part in host_port.address.split("."))
    frame = (
        Ether(dst="01:80:c2:00:00:0e", src="02:00:00:00:01:00", type=0x88CC)
        / LLDPDUChassisID(subtype=subtype, id=host_port.host)
        / LLDPDUPortID(subtype=7, id=host_port.name)
        / LLDPDUTimeToLive(ttl=ttl)
        / LLDPDUManagementAddress(
            management_address_subtype=1,
            management_address=address,
            interface_numbering_subtype=1,
        )
    )
    for data in abilities:
        code = int.from_bytes(OUI, "big")
        frame /= LLDPDUGenericOrganisationSpecific(org_code=code, subtype=SUBTYPE, data=data)
    return bytes(frame / LLDPDUEndOfLLDPDU())


def flow_mods(messages: list[Any]) -> list[Any]:
    return [message for message in messages if message.kind == ofproto.OFPT_FLOW_MOD]


def instructions(entry: Any) -> list[tuple[str, int]]:
    found = []
    for instruction in entry.instructions:
        if instruction.type == ofproto.OFPIT_GOTO_TABLE:
            found.append(("goto", instruction.table_id))
        else:
            (action,) = instruction.actions
            found.append(("output", action.port))
    return found


def test_a_classical_switch_gets_its_two_tables(scene: Scene) -> None:
    entries = flow_mods(scene.s1.take())
    added = [entry for entry in entries if entry.command == ofproto.OFPFC_ADD]
    wiped = [entry.table_id for entry in entries if entry.command == ofproto.OFPFC_DELETE]
    up, on = ("output", ofproto.OFPP_CONTROLLER), ("goto", 2)
    ends = {"eth_type": 0x0800, "ip_proto": 6}
    to_port, from_port = {**ends, "tcp_dst": METADATA_PORT}, {**ends, "tcp_src": METADATA_PORT}
    expected = [
        (2, 0, {}, [up]),
        (0, 0, {}, [("goto", 1)]),
        (1, 0, {}, [on]),
        (1, 250, {**to_port, "tcp_flags": (2, 23)}, [on]),
        (1, 200, to_port, [up]),
        (1, 200, {"eth_type": 0x0800, "ip_proto": 17, "udp_dst": DEVICE_PORT}, [up]),
        (1, 400, {**to_port, "tcp_flags": (1, 1)}, [up, on]),
        (1, 400, {**to_port, "tcp_flags": (4, 4)}, [up, on]),
        (1, 400, {**from_port, "tcp_flags": (4, 4)}, [up, on]),
        (1, 400, {**from_port, "tcp_flags": (18, 18)}, [up, on]),
    ]
    assert wiped == [2, 0, 1]
    assert [
        (entry.table_id, entry.priority, dict(entry.match.items()), instructions(entry))
        for entry in added
    ] == expected
    for entry in added:
        for instruction in entry.instructions:
            if instruction.type == ofproto.OFPIT_APPLY_ACTIONS:
                assert instruction.actions[0].max_len == ofproto.OFPCML_NO_BUFFER


def test_each_switch_is_asked_for_the_table_that_sessions_have_entries_in(scene: Scene) -> None:
    for switch, table in ((scene.s1, 1), (scene.q1, 0)):
        (asked,) = [m for m in switch.take() if getattr(m, "multipart", None) == ofproto.OFPMP_FLOW]
        assert asked.body[0] == table


def filtering(messages: list[Any]) -> list[tuple[int, dict[str, Any], list[tuple[str, int]]]]:
    """Return priority, match and instructions of the entries of the first table."""
    wiped, *added = [mod for mod in flow_mods(messages) if mod.table_id == 0]
    assert (wiped.command, dict(wiped.match.items())) == (ofproto.OFPFC_DELETE, {})
    return [(mod.priority, dict(mod.match.items()), instructions(mod)) for mod in added]


def test_stations_speak_for_themselves_unless_the_policy_lets_them(tmp_path: Path) -> None:
    on = [("goto", 1)]
    port, own = {"in_port": 1}, {"in_port": 1, "eth_src": MACS[ALICE]}
    arp = {"eth_type": 0x0806, "arp_sha": MACS[ALICE], "arp_spa": ALICE}
    expected = [
        (0, {}, on),
        (40, {**own, "eth_type": 0x0800, "ipv4_src": ALICE}, on),
        (40, {**own, **arp}, on),
        (30, {**port, "eth_type": 0x0800}, []),
        (30, {**port, "eth_type": 0x0806}, []),
        (30, {**port, "eth_type": 0x86DD}, []),
        (20, own, on),
        (10, port, []),
    ]
    scene = Scene(tmp_path, policy="")
    assert filtering(scene.s1.take()) == expected  # bob is at another switch
    for policy, entries in ((UNFILTERED, expected[:1]), ("", expected)):
        scene.policy_path.write_text(policy)
        question = EventQuestion("reload", {})
        scene.quantum.asked(question)
        question.wait()
        assert filtering(scene.s1.take()) == entries
        assert scene.quantum.arbiter.needs_handshake == (policy == "")


def test_fibres_of_a_quantum_switch_are_dark_but_for_lldp(scene: Scene) -> None:
    wiped, miss, entry, *questions = scene.q1.take()
    assert (wiped.table_id, miss.table_id) == (2, 2)
    assert entry.table_id == 0
    assert dict(entry.match.items()) == {"eth_type": 0x88CC}
    assert instructions(entry) == [("output", ofproto.OFPP_CONTROLLER)]
    asked = [question.multipart for question in questions]
    assert asked == [ofproto.OFPMP_FLOW, ofproto.OFPMP_EXPERIMENTER, ofproto.OFPMP_PORT_STATS]


def test_copper_of_a_quantum_switch_learns_like_any_other(scene: Scene) -> None:
    copper = fiber_port(7, optics=None)
    q1 = reconnect(scene, fiber_port(1), copper, fiber_port(2))
    entries = [m for m in q1.take() if m.kind == ofproto.OFPT_FLOW_MOD and m.priority == 1]
    assert [dict(entry.match.items()) for entry in entries] == [{"in_port": 7}]
    assert [instructions(entry) for entry in entries] == [[("goto", 2)]]
    frame = bytes.fromhex("ffffffffffff0200000000aa0800") + bytes(46)
    scene.packet_in(q1, 7, frame, table=2)
    (out,) = [m for m in q1.take() if m.kind == ofproto.OFPT_PACKET_OUT]
    assert (out.in_port, out.port, out.frame) == (7, ofproto.OFPP_FLOOD, frame)


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
    told = [(fact["at"], fact["up"]) for fact in ready.recorded() if fact["event"] == "port"]
    assert told == [(1, False), (1, True), (3, False)]


BAND = PortOptics(
    TUNABLE, 191_350_000, 196_100_000, 50_000, 191_350_000, 196_100_000, 50_000, -200, 0
)
LIGHT = PortLight(ALL_VALID, 193_500_000, 0, 0, 193_500_000, 0, 0, -30, -42, 500, 250)


def fiber_port(number: int, optics: PortOptics | None = BAND, up: bool = True) -> Any:
    """Return a port description as the framework decodes it."""
    prop = b"" if optics is None else optics.encode()
    state = 0 if up else ofproto.OFPPS_LINK_DOWN
    address = bytes([2, 0, 0, 0, 9, number])
    description = struct.pack("!IH2x6s2x16sII", number, 40 + len(prop), address, b"p", 0, state)
    return parser.OFPPort.parser(bytearray(description + prop), 0)


def spoken(messages: list[Any]) -> dict[int, bytes]:
    """Return the frames sent out, by port."""
    return {m.port: m.frame for m in messages if m.kind == ofproto.OFPT_PACKET_OUT}


def second_switch(scene: Scene, *ports: int) -> Datapath:
    """Connect a further quantum switch with fibres at the given ports."""
    scene.quantum.quantum_switches |= {Q1 + 1}
    q2 = Datapath(Q1 + 1)
    q2.ports = {number: fiber_port(number) for number in ports}
    scene.connect(q2)
    scene.tell_optics(q2)
    return q2


def reconnect(scene: Scene, *ports: Any) -> Datapath:
    """Connect the quantum switch again, with these ports."""
    scene.connect(scene.q1, framework.DEAD)
    scene.q1 = Datapath(Q1)
    scene.q1.ports = {port.port_no: port for port in ports}
    scene.connect(scene.q1)
    scene.tell_optics(scene.q1)
    return scene.q1


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
    q1, q2 = reconnect(scene, fiber_port(6)), second_switch(scene, 7)
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
        # What a changed bit leaves whole is still no more than what (Q1, 6) has said.
        assert {speaker for speaker, _ in heard.values()} <= {SwitchPort(Q1, 6)}
    assert scene.quantum.network.links == {}
    assert scene.quantum.dropped["lldp"] > 1000
    stock = genuine[: genuine.index(OUI) - 2] + b"\0\0"
    before = scene.quantum.dropped["lldp"]
    scene.packet_in(q2, 7, stock)  # another controller's: neither believed nor complained of
    assert scene.quantum.dropped["lldp"] == before


def test_ports_tell_how_they_can_be_tuned_and_what_they_measure(scene: Scene) -> None:
    q1 = reconnect(scene, fiber_port(6))
    optics = scene.quantum.network.optics
    assert optics.ranges == {(Q1, 6): BAND}
    scene.measure(q1, 6, LIGHT)
    assert optics.lights == {(Q1, 6): LIGHT}
    assert optics.tuned_mhz == {(Q1, 6): 193_500_000}


def test_optics_that_come_in_parts_are_taken_whole(scene: Scene) -> None:
    scene.connect(scene.q1, framework.DEAD)
    q1 = scene.q1 = Datapath(Q1)
    scene.connect(q1)
    one, two, others = (
        PathOptics(1, 2, 5, 1),
        PathOptics(2, 1, 6, 2),
        PathOptics(ANY_PORT, ANY_PORT, 7, 3),
    )
    scene.tell_optics(q1, one, two, more=True)
    assert Q1 not in scene.quantum.network.connected
    scene.tell_optics(q1, others)
    assert Q1 in scene.quantum.network.connected
    told = scene.quantum.network.optics.path
    assert [told(Q1, 1, 2), told(Q1, 2, 1), told(Q1, 3, 4)] == [one, two, others]


def test_a_switch_that_knows_nothing_of_optics_is_of_use_all_the_same(scene: Scene) -> None:
    scene.connect(scene.q1, framework.DEAD)
    q1 = scene.q1 = Datapath(Q1)
    scene.connect(q1)
    assert Q1 not in scene.quantum.network.connected
    error = parser.OFPErrorMsg(q1, ofproto.OFPET_BAD_REQUEST, ofproto.OFPBRC_BAD_EXPERIMENTER, b"")
    error.xid = asked_optics(q1)
    scene.quantum.switch_refused(SimpleNamespace(msg=error))
    assert Q1 in scene.quantum.network.connected


def test_ports_are_tuned_first_in_the_bundle(scene: Scene) -> None:
    q1 = reconnect(scene, *(fiber_port(number) for number in FIBERS))
    scene.announce()
    for number in (2, 3, 4, 5):
        scene.measure(q1, number, replace(LIGHT, tx_mhz=193_400_000, rx_mhz=193_400_000))
    scene.measure(q1, 1, LIGHT)
    scene.packet_in(scene.s1, 1, frame(FRAMED.encode()))
    _opening, tuning, *adds, _commit, _barrier = q1.take()
    assert len(adds) == 3
    message = tuning.inner
    assert message.kind == ofproto.OFPT_PORT_MOD
    assert struct.unpack_from("!I4x6s", message.data, 8) == (1, bytes([2, 0, 0, 0, 9, 1]))
    assert PortTuning.decode(message.data[32:]) == PortTuning(
        RX_TUNE | TX_TUNE | USE_FREQ, 193_400_000, 0, 0, 0
    )


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
    assert scene.quantum.dropped["lldp"] == len(rubbish)
    assert not scene.quantum.network.hosts


def test_hosts_say_what_they_can_do_or_what_they_say_is_not_heard(scene: Scene) -> None:
    able = replace(FIBERS[1], abilities=Abilities(EVERYTHING, 32))
    data = announcement(able)
    assert discovery.parse(data) == discovery.Announcement(able, leaving=False)
    told = able.abilities.encode() if able.abilities else b""
    refused = [told[:length] for length in range(len(told))]
    refused += [told + b"\0", b"\x1f" + told[1:], b"\x02" + bytes(4), b"\x0d" + told[1:]]
    for number, info in enumerate(refused, 1):
        wrong = announcement(FIBERS[1], told=(info,))
        with pytest.raises(MalformedPacket):
            discovery.parse(wrong)
        scene.packet_in(scene.q1, 1, wrong)
        assert scene.quantum.dropped["lldp"] == number
    with pytest.raises(MalformedPacket, match="tells 2 times"):
        discovery.parse(announcement(FIBERS[1], told=(told, told)))
    assert not scene.quantum.network.hosts
    scene.packet_in(scene.q1, 1, data)
    assert scene.quantum.network.abilities_of(able.address) == able.abilities
    question = EventQuestion("abilities", {})
    scene.quantum.asked(question)
    features = ["emit", "store", "gate", "measure"]
    assert question.wait() == {"alice": {"features": features, "memory_qubits": 32}}


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
    assert not ready.quantum._transactions
    events = [(line["event"], line.get("session")) for line in ready.recorded()]
    assert events[-2:] == [("path_ready", f"{7:016x}"), ("granted", f"{7:016x}")]
    ready_line = ready.recorded()[-2]
    assert ready_line["setup_ms"] > 0
    assert ready_line["packet_in_count"] == len(FIBERS) + 1


def test_a_swap_is_let_on_when_all_its_nodes_have_answered(
    ready: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[tuple[str, Any]] = []
    monkeypatch.setattr(ready.quantum, "send_event", lambda app, event: sent.append((app, event)))
    ready.packet_in(ready.s1, 1, frame(replace(FRAMED, service=Service.SWAP).encode()))
    ((app, event),) = sent
    assert app == "DeviceMonitor"
    assert [stop.address for stop in event.ordered.chain] == [ALICE, CHARLIE, BOB]
    for node in (ALICE, CHARLIE, BOB):
        assert ready.s1.take() == []
        ready.quantum.node_answered(EventNodeAnswered(FRAMED.session, node, Reason.OK))
    (let_on,) = ready.s1.take()
    answer = decode(payload_of(let_on.frame))
    assert isinstance(answer, Setup)
    assert answer.verdict == Verdict.GRANTED
    assert ready.recorded()[-2]["event"] == "chain_ready"


def test_a_policy_that_is_read_again_has_its_schedule(ready: Scene, tmp_path: Path) -> None:
    file = tmp_path / "policy.toml"
    file.write_text("[swap]\nschedule = 'nested'")
    ready.quantum.policy_path = str(file)
    ready.quantum.asked(EventQuestion("reload", {}))
    assert ready.quantum.arbiter.schedule == "nested"


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
    assert "forbidden" in [fact["event"] for fact in ready.recorded()]


def test_an_unknown_receiver_is_flooded(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, frame(replace(FRAMED, source="10.0.0.77").encode()))
    (sent,) = ready.s1.take()
    assert sent.port == ofproto.OFPP_FLOOD
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert answer.reason == Reason.UNKNOWN_HOST
    assert ready.recorded()[-1]["event"] == "refused"


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
    assert not ready.quantum._transactions


def test_an_error_of_something_else_refuses_nothing(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()))
    ready.q1.take()
    other = parser.OFPErrorMsg(ready.q1, ofproto.OFPET_BAD_REQUEST, 0, b"")
    other.xid = 0x7FFFFFFF
    ready.quantum.switch_refused(SimpleNamespace(msg=other))
    assert ready.q1.take() == ready.s1.take() == []


def grant(scene: Scene) -> None:
    scene.packet_in(scene.s1, 1, frame(FRAMED.encode()))
    scene.barrier(scene.q1.take()[-1].xid)
    scene.s1.take()


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
    (dark,) = ready.q1.take()
    assert (dark.command, dark.cookie) == (ofproto.OFPFC_DELETE, FRAMED.session)
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
    for xid, count in ((question.xid + 1, 4 << 20), (question.xid, 4 << 20)):
        assert ready.quantum.arbiter.is_live(FRAMED.session)
        counted = SimpleNamespace(byte_count=count)
        reply = SimpleNamespace(datapath=ready.s1, xid=xid, body=[counted], flags=0)
        ready.quantum.flows_listed(SimpleNamespace(msg=reply))
    assert not ready.quantum.arbiter.is_live(FRAMED.session)


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


def shift_clock(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    later = time.monotonic() + seconds
    monkeypatch.setattr("controller_apps.apps.quantum_metadata.time.monotonic", lambda: later)


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


def stats(scene: Scene, *entries: tuple[int, int, int]) -> None:
    """Answer the question for entries: cookie, in_port and out_port of each."""
    (xid,) = (xid for dpid, xid in scene.quantum._listed if dpid == scene.q1.id)
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
    assert ready.quantum.arbiter.is_live(FRAMED.session)
    other = replace(FRAMED, session=8)
    ready.packet_in(ready.s1, 1, frame(other.encode(), sport=41000))
    (sent,) = ready.s1.take()
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert answer.reason == Reason.NO_PATH
    shift_clock(monkeypatch, 10.0)
    ready.quantum.time_passed(None)
    assert ready.q1.take() == []
    assert ready.recorded()[-1]["detail"] == "switch gone"


def test_a_switch_that_is_soon_back_keeps_its_sessions_and_gets_what_it_lost(ready: Scene) -> None:
    grant(ready)
    again = Datapath(Q1)
    ready.connect(again)
    ready.connect(ready.q1, framework.DEAD)  # noticed only now
    assert ready.quantum.datapaths[Q1] is again
    ready.q1 = again
    ready.tell_optics(again)
    again.take()
    stats(ready, OWN[0], (99, 3, 4))
    messages = again.take()
    added = [m.inner for m in messages if m.kind == ofproto.OFPT_BUNDLE_ADD_MESSAGE]
    assert [(e.cookie, e.match["in_port"]) for e in added] == [(7, 1), (7, 5)]
    assert [m.cookie for m in flow_mods(messages)] == [99]
    assert ready.quantum.arbiter.is_live(FRAMED.session)


def test_a_connection_without_features_is_no_switch(ready: Scene) -> None:
    nobody = Datapath(0)
    nobody.id = None  # type: ignore[assignment]
    ready.connect(nobody, framework.DEAD)
    assert nobody.take() == []


def ethernet(source: int, destination: int) -> bytes:
    addresses = destination.to_bytes(6, "big") + source.to_bytes(6, "big")
    return addresses + b"\x99\x99" + bytes(50)


BROADCAST = (1 << 48) - 1
ONE, TWO = 0x020000000001, 0x020000000002


def test_unknown_stations_are_flooded_and_known_ones_learned(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, BROADCAST), table=2)
    (flooded,) = ready.s1.take()
    assert (flooded.in_port, flooded.port) == (1, ofproto.OFPP_FLOOD)
    assert flooded.frame == ethernet(ONE, BROADCAST)
    ready.packet_in(ready.s1, 2, ethernet(TWO, ONE), table=2)
    entry, sent = ready.s1.take()
    assert (sent.in_port, sent.port) == (2, 1)
    assert dict(entry.match.items()) == {
        "in_port": 2,
        "eth_src": "02:00:00:00:00:02",
        "eth_dst": "02:00:00:00:00:01",
    }
    assert (entry.table_id, instructions(entry)) == (2, [("output", 1)])
    assert entry.idle_timeout > 0


def test_a_station_that_moves_is_found_again(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, BROADCAST), table=2)
    ready.packet_in(ready.s1, 3, ethernet(ONE, BROADCAST), table=2)
    _, deleted, _ = ready.s1.take()
    assert (deleted.command, deleted.table_id) == (ofproto.OFPFC_DELETE, 2)
    assert dict(deleted.match.items()) == {"eth_dst": "02:00:00:00:00:01"}
    assert ready.learning.mac_table.port_of(S1, ONE.to_bytes(6, "big")) == 3


def test_link_local_frames_and_stumps_are_not_forwarded(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, 0x0180C200000E), table=2)
    ready.packet_in(ready.s1, 1, b"\0" * 11, table=2)
    assert ready.s1.take() == []


def test_each_app_leaves_the_other_ones_packets_alone(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, frame(b"no magic"), table=1)
    assert ready.s1.take() == []
    assert ready.quantum.dropped == {"malformed": 1}
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()), table=2)
    assert [sent.kind for sent in ready.s1.take()] == [ofproto.OFPT_PACKET_OUT]
    assert ready.q1.take() == []


def test_the_end_is_recorded_with_all_packets_counted(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, BROADCAST), table=2)
    ready.quantum.close()
    last = ready.recorded()[-1]
    assert (last["event"], last["packet_in_count"]) == ("stopped", len(FIBERS) + 1)


def test_a_second_controller_begins_with_what_the_first_has_kept(tmp_path: Path) -> None:
    first = Scene(tmp_path, str(tmp_path / "state"))
    first.announce()
    grant(first)
    second = Scene(tmp_path, str(tmp_path / "state"))
    assert second.quantum.network.hosts == first.quantum.network.hosts
    assert second.quantum.arbiter.is_live(FRAMED.session)
    resumed = [fact for fact in second.recorded() if fact["event"] == "resumed"]
    assert [fact["session"] for fact in resumed] == [f"{FRAMED.session:016x}"]


def list_bypasses(scene: Scene, *entries: Any) -> None:
    """Answer the question for the entries of the classical switch."""
    (xid,) = (xid for dpid, xid in scene.quantum._listed if dpid == S1)
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
