"""The apps with datapaths that record what they are sent, on the framework of this process.

Messages are encoded by the framework and read back with its own parser where it can.
"""

import json
import struct
import time
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
from controller_apps.light.paths import HostPort
from controller_apps.openflow import framework
from controller_apps.openflow.framework import ProtocolDesc, ofp_event, ofproto, parser
from controller_apps.openflow.mac_table import MacTable
from controller_apps.record import Record
from controller_apps.sessions.state_folder import StateFolder
from wire.config import ControllerConfig, Station
from wire.lldp import FEATURES, OUI
from wire.optical import (
    ANY_PORT,
    EXPERIMENTER,
    PATH_OPTICS,
    TUNABLE,
    PathOptics,
    PortLight,
    PortOptics,
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
        self.unreplied_echo_requests: list[int] = []
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
        if kind in (ofproto.OFPT_PORT_MOD, ofproto.OFPT_METER_MOD):
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


UNFILTERED = "[filter]\naddresses = false\nhandshakes = false\nnumbers = false\n"


STATIONS = [Station(S1, 1, MACS[ALICE], ALICE), Station(77, 1, MACS[BOB], BOB)]


class Scene:
    """Both apps, a classical and a quantum switch, all fibres announced."""

    def __init__(
        self,
        folder: Path,
        state: str = "",
        policy: str = UNFILTERED,
        keys: dict[str, str] | None = None,
        **settings: Any,
    ) -> None:
        self.record_path, self.policy_path = folder / "record.jsonl", folder / "policy.toml"
        self.policy_path.write_text(policy)
        config = ControllerConfig(
            "127.0.0.1:6653",
            framework.NAME,
            {"q1": Q1},
            HOLD_S,
            30,
            str(self.record_path),
            policy=str(self.policy_path),
            stations=STATIONS,
            device_keys=keys or {},
            addresses={name: {"bob": BOB, "charlie": CHARLIE}[name] for name in keys or {}},
            **settings,
        )
        mac_table, record = MacTable(), Record(str(self.record_path))
        self.learning = LearningSwitch(config, mac_table, record=record)
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
        self.quantum.optics_reported(SimpleNamespace(msg=reply))

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


def asked_optics(datapath: Datapath) -> int:
    """Return the transaction id of the last question for optics."""
    kind = ofproto.OFPMP_EXPERIMENTER
    return int([m.xid for m in datapath.sent if getattr(m, "multipart", None) == kind][-1])


def announcement(
    host_port: HostPort, ttl: int = 120, subtype: int = 7, report: tuple[bytes, ...] = ()
) -> bytes:
    """Return an announcement; `report` are contents of TLVs of features, if not the port's own."""
    node_features = (host_port.node_features.encode(),) if host_port.node_features else report
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
    for data in node_features:
        code = int.from_bytes(OUI, "big")
        frame /= LLDPDUGenericOrganisationSpecific(org_code=code, subtype=FEATURES, data=data)
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


BAND = PortOptics(
    TUNABLE, 191_350_000, 196_100_000, 50_000, 191_350_000, 196_100_000, 50_000, -200, 0
)


def fiber_port(number: int, optics: PortOptics | None = BAND, up: bool = True) -> Any:
    """Return a port description as the framework decodes it."""
    prop = b"" if optics is None else optics.encode()
    state = 0 if up else ofproto.OFPPS_LINK_DOWN
    address = bytes([2, 0, 0, 0, 9, number])
    description = struct.pack("!IH2x6s2x16sII", number, 40 + len(prop), address, b"p", 0, state)
    return parser.OFPPort.parser(bytearray(description + prop), 0)


def reconnect(scene: Scene, *ports: Any) -> Datapath:
    """Connect the quantum switch again, with these ports."""
    scene.connect(scene.q1, framework.DEAD)
    scene.q1 = Datapath(Q1)
    scene.q1.ports = {port.port_no: port for port in ports}
    scene.connect(scene.q1)
    scene.tell_optics(scene.q1)
    return scene.q1


def grant(scene: Scene) -> None:
    scene.packet_in(scene.s1, 1, frame(FRAMED.encode()))
    scene.barrier(scene.q1.take()[-1].xid)
    scene.s1.take()


def shift_clock(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    later = time.monotonic() + seconds
    monkeypatch.setattr("controller_apps.apps.quantum_metadata.time.monotonic", lambda: later)


def ethernet(source: int, destination: int) -> bytes:
    addresses = destination.to_bytes(6, "big") + source.to_bytes(6, "big")
    return addresses + b"\x99\x99" + bytes(50)


BROADCAST = (1 << 48) - 1


ONE, TWO = 0x020000000001, 0x020000000002


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


@pytest.fixture
def ready(scene: Scene) -> Scene:
    scene.announce()
    return scene
