"""Ethernet frames that carry TCP over IPv4: read them, and replace their payload.

Written out with struct because the frameworks' packet library loops for ever on a TCP
option of length 0, and loses the ECE and CWR flags when it writes a segment again.
"""

import struct
from dataclasses import dataclass
from socket import inet_ntoa
from typing import NamedTuple

from wire.malformed import MalformedPacket

ETHERNET_LENGTH = 14
FIN, SYN, RST, PSH, ACK = 1, 2, 4, 8, 16
IP_TCP = 6
_IP = struct.Struct("!BxHxxHxBxx4s4s")
_TCP = struct.Struct("!HHIIBB")


class FiveTuple(NamedTuple):
    """A TCP connection as its opener sees it; the fifth member, the protocol, is TCP."""

    source: str
    source_port: int
    destination: str
    destination_port: int

    def reverse(self) -> "FiveTuple":
        return FiveTuple(self.destination, self.destination_port, self.source, self.source_port)


@dataclass(frozen=True)
class Segment:
    """One TCP segment in its frame."""

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
        return not parse(frame).payload
    except MalformedPacket:
        return False


def parse(frame: bytes) -> Segment:
    """Read a frame; raise MalformedPacket if it is not one whole segment over IPv4."""
    try:
        return _parse(frame)
    except struct.error as error:
        raise MalformedPacket(f"frame of {len(frame)} bytes is cut short") from error


def _parse(frame: bytes) -> Segment:
    if frame[12:14] != b"\x08\x00":
        raise MalformedPacket(f"EtherType {frame[12:14].hex()} is not IPv4")
    version, length, fragment, protocol, source, destination = _IP.unpack_from(
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
