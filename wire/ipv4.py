"""IPv4 packets (RFC 791) back to back in a stream, and the ICMP errors that say why one is lost.

Their own length says where each ends, so that the stream needs nothing between them. What cannot
be a packet is refused, and with it all that comes behind: nobody knows where the next one begins.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import IPv4Address

from wire.metadata import MalformedPacket

HEADER = struct.Struct("!BBHHHBBH4s4s")
ICMP = struct.Struct("!BBHI")
VERSION = 4
ICMP_PROTOCOL = 1
UNREACHABLE = 3  # ICMP type: destination unreachable
ERRORS = (3, 4, 5, 11, 12)  # ICMP types that must not be answered with another error
FRAGMENT_OFFSET = 0x1FFF
TTL = 64
BROADCAST = IPv4Address("255.255.255.255")
QUOTED_BYTES = 548  # of what was lost: an error has 576 bytes at most (RFC 1812, 4.3.2.3)


class Unreachable(IntEnum):
    """Why a destination cannot be reached (RFC 792; RFC 1812, 5.2.7.1)."""

    NETWORK = 0
    HOST = 1
    PORT = 3
    HOST_UNKNOWN = 7
    PROHIBITED = 13  # communication administratively prohibited


@dataclass(frozen=True)
class Packet:
    """One packet, whole; `data` are its bytes, header and all."""

    data: bytes
    source: IPv4Address
    destination: IPv4Address
    protocol: int
    first: bool  # whether it is no fragment but the first
    header_bytes: int

    @property
    def may_be_answered(self) -> bool:
        """Whether an ICMP error may tell its sender that it is lost (RFC 1122, 3.2.2)."""
        to_many = self.destination.is_multicast or self.destination == BROADCAST
        nobody = self.source.is_multicast or self.source.is_unspecified or self.source.is_loopback
        if not self.first or to_many or nobody or self.source == BROADCAST:
            return False
        body = self.data[self.header_bytes :]
        return self.protocol != ICMP_PROTOCOL or (bool(body) and body[0] not in ERRORS)


def packet_bytes(data: bytes, most: int) -> int | None:
    """Return the length of the packet that data begins with, None if its header is not whole.

    Raise MalformedPacket if it is none, or longer than `most` bytes.
    """
    if data and data[0] >> 4 != VERSION:
        raise MalformedPacket(f"IP version {data[0] >> 4}: only {VERSION} goes over light")
    if len(data) < HEADER.size:
        return None
    first, total = data[0], int.from_bytes(data[2:4])
    header_bytes = 4 * (first & 15)
    if not HEADER.size <= header_bytes <= total:
        raise MalformedPacket(f"IPv4 header of {header_bytes} bytes in a packet of {total}")
    if total > most:
        raise MalformedPacket(f"IPv4 packet of {total} bytes, at most {most} are taken")
    return total


def decode(data: bytes, most: int) -> Packet:
    """Return one whole packet; raise MalformedPacket if the data are not exactly that."""
    total = packet_bytes(data, most)
    if total != len(data):
        raise MalformedPacket(f"{len(data)} bytes are not one IPv4 packet")
    first, _tos, _total, _id, fragment, _ttl, protocol, _check, source, destination = (
        HEADER.unpack_from(data)
    )
    header_bytes = 4 * (first & 15)
    if checksum(data[:header_bytes]) != 0:
        raise MalformedPacket("the check of an IPv4 header is wrong")
    return Packet(
        data,
        IPv4Address(source),
        IPv4Address(destination),
        protocol,
        not fragment & FRAGMENT_OFFSET,
        header_bytes,
    )


class PacketStream:
    """Bytes of a stream, as they come, into packets."""

    def __init__(self, most: int) -> None:
        """Begin; no packet may have more than `most` bytes."""
        self._most = most
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that are whole now; raise MalformedPacket for what is none."""
        self._rest += data
        found = []
        at = 0
        while (total := packet_bytes(self._rest[at : at + HEADER.size], self._most)) is not None:
            if at + total > len(self._rest):
                break
            found.append(decode(self._rest[at : at + total], self._most))
            at += total
        self._rest = self._rest[at:]
        return found


def unreachable(lost: Packet, why: Unreachable, router: IPv4Address) -> bytes:
    """Return the packet by which a router tells the sender of another that it is lost."""
    quoted = lost.data[:QUOTED_BYTES]
    body = ICMP.pack(UNREACHABLE, why, 0, 0) + quoted
    body = ICMP.pack(UNREACHABLE, why, checksum(body), 0) + quoted
    fields = VERSION << 4 | HEADER.size // 4, 0, HEADER.size + len(body), 0, 0, TTL, ICMP_PROTOCOL
    ends = router.packed, lost.source.packed
    header = HEADER.pack(*fields, 0, *ends)
    return HEADER.pack(*fields, checksum(header), *ends) + body


def checksum(data: bytes) -> int:
    """Return the Internet checksum (RFC 1071); 0 for data that contain their own right one."""
    padded = data + bytes(len(data) % 2)
    total: int = sum(struct.unpack(f"!{len(padded) // 2}H", padded))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF
