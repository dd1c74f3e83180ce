"""IPv4 (RFC 791): how long a packet is, what it says, and the ICMP error that it is lost."""

import struct
from ipaddress import IPv4Address, IPv6Address

from applications.ip_over_light.lost_packet import Packet, Unreachable, checksum
from wire.malformed import MalformedPacket

HEADER = struct.Struct("!BBHHHBBH4s4s")
ICMP = struct.Struct("!BBHI")
VERSION = 4
ICMP_PROTOCOL = 1
UNREACHABLE = 3  # ICMP type: destination unreachable
ERRORS = (3, 4, 5, 11, 12)  # ICMP types that must not be answered with another error
FRAGMENT_OFFSET = 0x1FFF
TTL = 64
QUOTED_BYTES = 548  # of what was lost: an error has 576 bytes at most (RFC 1812, 4.3.2.3)


def packet_bytes(data: bytes, most: int) -> int | None:
    """Return the length of the packet that data begins with, None if its header is not whole.

    Raise MalformedPacket if it is not one, or longer than `most` bytes.
    """
    if len(data) < HEADER.size:
        return None
    first, total = data[0], int.from_bytes(data[2:4])
    header_bytes = 4 * (first & 15)
    if not HEADER.size <= header_bytes <= total:
        raise MalformedPacket(f"IPv4 header of {header_bytes} bytes in a packet of {total}")
    if total > most:
        raise MalformedPacket(f"IPv4 packet of {total} bytes, at most {most} are taken")
    return total


def decode(data: bytes) -> Packet:
    """Return a packet of the length that it says; raise MalformedPacket if its check is wrong."""
    first, _tos, _total, _id, fragment, _ttl, protocol, _check, source, destination = (
        HEADER.unpack_from(data)
    )
    header_bytes = 4 * (first & 15)
    if checksum(data[:header_bytes]) != 0:
        raise MalformedPacket("the check of an IPv4 header is wrong")
    body = data[header_bytes : header_bytes + 1]
    return Packet(
        data,
        IPv4Address(source),
        IPv4Address(destination),
        protocol,
        not fragment & FRAGMENT_OFFSET,
        header_bytes,
        protocol == ICMP_PROTOCOL and (not body or body[0] in ERRORS),
    )


def unreachable(lost: Packet, why: Unreachable, router: IPv4Address | IPv6Address) -> bytes:
    quoted = lost.data[:QUOTED_BYTES]
    body = ICMP.pack(UNREACHABLE, why, 0, 0) + quoted
    body = ICMP.pack(UNREACHABLE, why, checksum(body), 0) + quoted
    kind, length = VERSION << 4 | HEADER.size // 4, HEADER.size + len(body)
    here, source = router.packed, lost.source.packed
    header = HEADER.pack(kind, 0, length, 0, 0, TTL, ICMP_PROTOCOL, 0, here, source)
    return (
        HEADER.pack(kind, 0, length, 0, 0, TTL, ICMP_PROTOCOL, checksum(header), here, source)
        + body
    )
