"""Ethernet frames that carry TCP or UDP over IPv4, as switches hand them to the controller.

Segments of TCP are read, and their payload replaced; datagrams go to node agents, and come from
them. Written out with struct because the frameworks' packet library loops for ever on a TCP
option of length 0, and loses the ECE and CWR flags when it writes a segment again.
"""

import struct
from dataclasses import dataclass
from functools import lru_cache
from ipaddress import IPv4Address
from socket import inet_ntoa
from typing import NamedTuple

from wire.device import DEVICE_PORT
from wire.malformed import MalformedPacket

ETHERNET_LENGTH = 14
FIN, SYN, RST, PSH, ACK = 1, 2, 4, 8, 16
IP_TCP = 6
_IP_READ = struct.Struct("!BxHxxHxBxx4s4s")
_TCP = struct.Struct("!HHIIBB")
IP_UDP = 17
LLDP = b"\x88\xcc"  # EtherType
TTL = 64
CONTROLLER_MAC = bytes.fromhex("02514d000001")  # locally administered
_IP = struct.Struct("!BBHHHBBH4s4s")
_UDP = struct.Struct("!HHHH")


class FiveTuple(NamedTuple):
    """A TCP connection as its opener sees it; the fifth member, the protocol, is TCP."""

    source: str
    source_port: int
    destination: str
    destination_port: int

    def reverse(self) -> "FiveTuple":
        return FiveTuple(self.destination, self.destination_port, self.source, self.source_port)


class Segment(NamedTuple):
    frame: bytes
    five_tuple: FiveTuple
    sequence: int
    acknowledged: int  # the next byte that is wanted, if the flags have ACK
    flags: int
    tcp_offset: int
    payload_offset: int
    end: int  # of the IP packet; what follows in the frame is padding

    @property
    def payload(self) -> bytes:
        return self.frame[self.payload_offset : self.end]

    @property
    def closes(self) -> bool:
        return bool(self.flags & (FIN | RST))

    @property
    def accepts(self) -> bool:
        return self.flags & (SYN | ACK | FIN | RST) == SYN | ACK

    @property
    def after(self) -> int:
        return (self.sequence + self.end - self.payload_offset) & 0xFFFFFFFF

    def with_payload(self, payload: bytes) -> bytes:
        ip = bytearray(self.frame[ETHERNET_LENGTH : self.tcp_offset])
        tcp = bytearray(self.frame[self.tcp_offset : self.payload_offset]) + payload
        struct.pack_into("!H", ip, 2, len(ip) + len(tcp))
        struct.pack_into("!H", ip, 10, 0)
        struct.pack_into("!H", ip, 10, checksum(ip))
        pseudo_header = ip[12:20] + struct.pack("!HH", IP_TCP, len(tcp))
        struct.pack_into("!H", tcp, 16, 0)
        struct.pack_into("!H", tcp, 16, checksum(pseudo_header + tcp))
        return self.frame[:ETHERNET_LENGTH] + bytes(ip + tcp)


def is_tcp(frame: bytes) -> bool:
    """Tell whether an IPv4 frame says that it carries TCP."""
    return frame[23:24] == bytes([IP_TCP])


def is_without_data(frame: bytes) -> bool:
    """Tell whether a frame is a TCP segment that acknowledges, opens or closes, and no more."""
    try:
        return not parse_segment(frame).payload
    except MalformedPacket:
        return False


@lru_cache(maxsize=1)  # the journal and the arbiter read each frame, one after the other
def parse_segment(frame: bytes) -> Segment:
    """Read a frame; raise MalformedPacket if it is not one whole segment over IPv4."""
    try:
        return _parse(frame)
    except struct.error as error:
        raise MalformedPacket(f"frame of {len(frame)} bytes is cut short") from error


def _parse(frame: bytes) -> Segment:
    if frame[12:14] != b"\x08\x00":
        raise MalformedPacket(f"EtherType {frame[12:14].hex()} is not IPv4")
    version, length, fragment, protocol, source, destination = _IP_READ.unpack_from(
        frame, ETHERNET_LENGTH
    )
    tcp_offset = ETHERNET_LENGTH + 4 * (version & 0xF)
    end = ETHERNET_LENGTH + length
    if version >> 4 != 4 or version & 0xF < 5 or protocol != IP_TCP:
        raise MalformedPacket(f"version byte {version:#x}, protocol {protocol}: not TCP over IPv4")
    if fragment & 0x3FFF:
        raise MalformedPacket("a fragment, not a whole packet")
    source_port, destination_port, sequence, acknowledged, offset, flags = _TCP.unpack_from(
        frame, tcp_offset
    )
    payload_offset = tcp_offset + 4 * (offset >> 4)
    if offset >> 4 < 5 or not payload_offset <= end <= len(frame):
        raise MalformedPacket(f"headers and lengths do not fit into {len(frame)} bytes")
    return Segment(
        frame=frame,
        five_tuple=FiveTuple(
            inet_ntoa(source), source_port, inet_ntoa(destination), destination_port
        ),
        sequence=sequence,
        acknowledged=acknowledged,
        flags=flags,
        tcp_offset=tcp_offset,
        payload_offset=payload_offset,
        end=end,
    )


def checksum(data: bytes | bytearray) -> int:
    """Return the Internet checksum (RFC 1071)."""
    padded = bytes(data) + b"\0" * (len(data) % 2)
    total: int = sum(struct.unpack(f"!{len(padded) // 2}H", padded))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


@dataclass(frozen=True)
class Frame:
    """One datagram in its frame; hardware addresses are six bytes."""

    source_mac: bytes
    destination_mac: bytes
    source: str
    destination: str
    source_port: int
    destination_port: int
    payload: bytes

    def encode(self) -> bytes:
        source, destination = IPv4Address(self.source).packed, IPv4Address(self.destination).packed
        length = _UDP.size + len(self.payload)
        ip = bytearray(
            _IP.pack(0x45, 0, _IP.size + length, 0, 0x4000, TTL, IP_UDP, 0, source, destination)
        )
        struct.pack_into("!H", ip, 10, checksum(ip))
        udp = bytearray(_UDP.pack(self.source_port, self.destination_port, length, 0))
        pseudo_header = source + destination + struct.pack("!HH", IP_UDP, length)
        struct.pack_into("!H", udp, 6, checksum(pseudo_header + udp + self.payload) or 0xFFFF)
        return self.destination_mac + self.source_mac + b"\x08\x00" + ip + udp + self.payload

    @classmethod
    def decode(cls, frame: bytes) -> "Frame":
        """Read a frame; raise MalformedPacket unless it is one whole datagram over IPv4."""
        try:
            return cls._decode(frame)
        except struct.error as error:
            raise MalformedPacket(f"frame of {len(frame)} bytes is cut short") from error

    @classmethod
    def _decode(cls, frame: bytes) -> "Frame":
        if not is_udp(frame):
            raise MalformedPacket("not UDP over IPv4")
        version, _, length, _, fragment, _, _, _, source, destination = _IP.unpack_from(
            frame, ETHERNET_LENGTH
        )
        udp_at = ETHERNET_LENGTH + 4 * (version & 0xF)
        end = ETHERNET_LENGTH + length
        source_port, destination_port, udp_length, _ = _UDP.unpack_from(frame, udp_at)
        whole = version & 0xF >= 5 and not fragment & 0x3FFF and end <= len(frame)
        if not whole or not _UDP.size <= udp_length == end - udp_at:
            raise MalformedPacket(f"headers and lengths do not fit into {len(frame)} bytes")
        return cls(
            frame[6:12],
            frame[:6],
            str(IPv4Address(source)),
            str(IPv4Address(destination)),
            source_port,
            destination_port,
            frame[udp_at + _UDP.size : end],
        )


def is_udp(frame: bytes) -> bool:
    """Tell whether a frame says that it carries UDP over IPv4."""
    version_4 = b"\x45" <= frame[14:15] <= b"\x4f"  # with a header of 20 to 60 bytes
    return frame[12:14] == b"\x08\x00" and version_4 and frame[23:24] == b"\x11"


def is_management(frame: bytes) -> bool:
    """Tell whether a frame is LLDP, or from an agent or a key manager to the controller."""
    if not is_udp(frame):
        return frame[12:14] == LLDP
    try:
        return Frame.decode(frame).destination_port == DEVICE_PORT
    except MalformedPacket:
        return False
