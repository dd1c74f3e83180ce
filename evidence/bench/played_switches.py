"""A classical and a quantum switch that are played to a controller, with hosts that want light.

    host 1 -- s1, q1 -- host 2        each two hosts have a copper port of s1 each, and a fibre of
    host 3 -- s1, q1 -- host 4        q1 each; the first asks for light to the second

OpenFlow 1.4, as Open vSwitch and our agent speak it, without either: what a controller takes is
measured by itself.
"""

import asyncio
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from ipaddress import IPv4Address

from controller_apps.packets import ACK, PSH, RST, SYN
from qmn.timeouts import TURN_TIMEOUT_S
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import messages
from qswitch_agent.openflow.messages import Framer, encode, hello, message_type, transaction_id
from qswitch_agent.openflow.packets import BUNDLE, PacketOut, bundle_control
from qswitch_agent.openflow.ports import Port
from wire.config import Station
from wire.features import EVERYTHING, NodeFeatures
from wire.lldp import announcement
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT, session_number
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.optical import PATH_OPTICS, PortOptics, encode_path_optics

S1, Q1 = 1, 2  # datapath ids
FEATURES_REQUEST = 5  # OFPT_, which the agent passes on and does not know
FEATURES = struct.Struct(ofp.OFP_SWITCH_FEATURES_PACK_STR)
PACKET_IN = struct.Struct(ofp.OFP_PACKET_IN_PACK_STR)
MATCH = struct.Struct("!HHII4x")  # of an in_port: type, length; OXM, port
IN_PORT = MATCH.size - 4, 0x80000004  # length without what fills it up; OXM header
ACTION = 1  # OFPR_, why a packet comes
C_BAND = 191_350_000, 196_100_000, 12_500  # MHz: least, most, grid
TUNABLE = PortOptics(3, *C_BAND, *C_BAND, -200, 0)
BEGINNINGS = 1000, 5000  # first sequence numbers of opener and acceptor
MEMORY_QUBITS = 1000
METADATA_TABLE, LIGHT_TABLE = 1, 0


@dataclass(frozen=True)
class Host:
    """A host at port `number` of both switches."""

    number: int
    key: str

    @property
    def name(self) -> str:
        return f"h{self.number}"

    @property
    def address(self) -> str:
        return str(IPv4Address("10.0.0.0") + self.number)

    @property
    def fiber(self) -> str:
        return f"{self.name}-q0"

    @property
    def mac(self) -> bytes:
        return bytes([2, 0, 0, 0]) + self.number.to_bytes(2, "big")

    @property
    def station(self) -> Station:
        return Station(S1, self.number, self.mac.hex(":"), self.address)

    def announcement(self) -> bytes:
        able = NodeFeatures(EVERYTHING, MEMORY_QUBITS)
        number = time.time_ns()
        return announcement(
            self.name, self.fiber, self.address, self.mac, 120, able, self.key, number
        )


class Switch:
    """One connection to a controller, and what it asks for answered."""

    def __init__(self, dpid: int, ports: list[Port], heard: Callable[[bytes], None]) -> None:
        """Call `heard` with each message that is not a question about the switch."""
        self.dpid, self._ports, self._heard = dpid, ports, heard
        self._framer = Framer()

    async def connect(self, host: str, port: int) -> None:
        self._reader, self._writer = await asyncio.open_connection(host, port)
        self._writer.write(hello())

    async def serve(self) -> None:
        """Answer until the controller closes, or is silent."""
        while data := await asyncio.wait_for(self._reader.read(1 << 16), TURN_TIMEOUT_S):
            for message in self._framer.feed(data):
                self._answer(message)
        raise ConnectionError(f"the controller has closed the connection of switch {self.dpid}")

    def packet_in(self, port: int, table: int, frame: bytes) -> bytes:
        fixed = PACKET_IN.pack(ofp.OFP_NO_BUFFER, len(frame), ACTION, table, 0)
        match = MATCH.pack(1, IN_PORT[0], IN_PORT[1], port)
        return encode(ofp.OFPT_PACKET_IN, 0, fixed + match + bytes(2) + frame)

    def send(self, *messages: bytes) -> None:
        self._writer.write(b"".join(messages))

    def close(self) -> None:
        self._writer.close()

    def _answer(self, message: bytes) -> None:
        kind, xid = message_type(message), transaction_id(message)
        if kind == ofp.OFPT_ECHO_REQUEST:
            self.send(encode(ofp.OFPT_ECHO_REPLY, xid, message[8:]))
        elif kind == FEATURES_REQUEST:
            self.send(
                encode(ofp.OFPT_FEATURES_REPLY, xid, FEATURES.pack(self.dpid, 0, 254, 0, 0, 0))
            )
        elif kind == ofp.OFPT_BARRIER_REQUEST:
            self.send(encode(ofp.OFPT_BARRIER_REPLY, xid))
        elif kind == ofp.OFPT_MULTIPART_REQUEST:
            self.send(self._told(message, xid))
        elif kind == ofp.OFPT_BUNDLE_CONTROL:
            bundle, request, flags = bundle_control(message)
            body = BUNDLE.pack(bundle, request + 1, flags)  # a reply is one above its request
            self.send(encode(ofp.OFPT_BUNDLE_CONTROL, xid, body))
        else:
            self._heard(message)

    def _told(self, message: bytes, xid: int) -> bytes:
        if messages.asked_of_us(message) == PATH_OPTICS:
            return messages.reply_of_ours(xid, PATH_OPTICS, encode_path_optics([]))
        kind = messages.multipart_type(message)
        ports = self._ports if kind == ofp.OFPMP_PORT_DESC else []
        return messages.reply(kind, xid, [port.encode() for port in ports])


@dataclass
class Asking:
    """One connection of a host that asks another for light."""

    opener: Host
    acceptor: Host
    place: int  # among all that are asked for
    verdict: asyncio.Future[Setup] = field(default_factory=asyncio.Future)
    closed: asyncio.Future[None] = field(default_factory=asyncio.Future)

    @property
    def session(self) -> int:
        return session_number(self.opener.address, self.place)

    @property
    def source_port(self) -> int:
        return 1024 + self.place % 60_000

    def asked(self) -> tuple[bytes, bytes]:
        opener, acceptor = self.opener, self.acceptor
        setup = Setup(
            self.session, Service["BB84"], Handshake.FRAMED, opener.address, 1000, 100, 1_000_000
        )
        theirs, ours = BEGINNINGS[1] + 1, BEGINNINGS[0] + 1
        to_port = self.source_port, METADATA_PORT
        answer = segment(acceptor, opener, to_port[::-1], (BEGINNINGS[1], ours), SYN | ACK)
        return answer, segment(opener, acceptor, to_port, (ours, theirs), PSH | ACK, setup.encode())

    def ended(self) -> bytes:
        at = BEGINNINGS[0] + 1 + SETUP_LENGTH, BEGINNINGS[1] + 1
        ports = self.source_port, METADATA_PORT
        return segment(self.opener, self.acceptor, ports, at, RST | ACK)


def segment(
    source: Host,
    destination: Host,
    ports: tuple[int, int],
    numbers: tuple[int, int],
    flags: int,
    payload: bytes = b"",
) -> bytes:
    """Return a TCP segment in its frame; the controller looks at no checksum."""
    ethernet = destination.mac + source.mac + b"\x08\x00"
    ends = IPv4Address(source.address).packed + IPv4Address(destination.address).packed
    ip = struct.pack("!BBHIBBH", 0x45, 0, 40 + len(payload), 0, 64, 6, 0) + ends
    tcp = struct.pack("!HHIIBBHI", *ports, *numbers, 5 << 4, flags, 64_000, 0)
    return ethernet + ip + tcp + payload


class PlayedNetwork:
    def __init__(self, hosts: list[Host]) -> None:
        """Each two of them are opener and acceptor."""
        self.hosts = hosts
        self._asking: dict[int, Asking] = {}
        ports = [Port(h.number, h.mac, f"p{h.number}", 0, 0, b"") for h in hosts]
        light = TUNABLE.encode()
        fibers = [Port(h.number, h.mac, f"f{h.number}", 0, 0, light) for h in hosts]
        self.s1 = Switch(S1, ports, self._heard_by_s1)
        self.q1 = Switch(Q1, fibers, self._heard_by_q1)

    def announce(self) -> None:
        frames = [(host.number, LIGHT_TABLE, host.announcement()) for host in self.hosts]
        self.q1.send(*(self.q1.packet_in(*frame) for frame in frames))

    async def ask(self, opener: Host, acceptor: Host, place: int) -> Setup:
        asking = Asking(opener, acceptor, place)
        self._asking[asking.session] = asking
        answer, setup = asking.asked()
        self.s1.send(
            self.s1.packet_in(acceptor.number, METADATA_TABLE, answer),
            self.s1.packet_in(opener.number, METADATA_TABLE, setup),
        )
        return await asyncio.wait_for(asking.verdict, TURN_TIMEOUT_S)

    async def give_back(self, session: int) -> None:
        """End a session that has light; return when its path is deleted."""
        asking = self._asking[session]
        self.s1.send(self.s1.packet_in(asking.opener.number, METADATA_TABLE, asking.ended()))
        await asyncio.wait_for(asking.closed, TURN_TIMEOUT_S)
        del self._asking[session]

    def close(self, session: int) -> None:
        asking = self._asking.pop(session)
        self.s1.send(self.s1.packet_in(asking.opener.number, METADATA_TABLE, asking.ended()))

    def _heard_by_s1(self, message: bytes) -> None:
        if message_type(message) != ofp.OFPT_PACKET_OUT:
            return
        frame = PacketOut.decode(message).frame
        try:
            setup = decode(frame[-SETUP_LENGTH:])
        except MalformedPacket:
            return  # of a node agent
        if isinstance(setup, Setup) and setup.session in self._asking:
            self._asking[setup.session].verdict.set_result(setup)

    def _heard_by_q1(self, message: bytes) -> None:
        if message_type(message) == ofp.OFPT_FLOW_MOD:
            cookie = int.from_bytes(message[8:16], "big")
            if cookie in self._asking:
                self._asking[cookie].closed.set_result(None)
