"""IPv6 (RFC 8200): how long a packet is, what it says, and the ICMPv6 error that it is lost."""

import struct
from collections.abc import Mapping
from ipaddress import IPv4Address, IPv6Address
from types import MappingProxyType

from applications.ip_over_light.lost_packet import Packet, Unreachable, checksum
from wire.malformed import MalformedPacket

HEADER = struct.Struct("!IHBB16s16s")
PSEUDO_HEADER = struct.Struct("!16s16sII")
ICMPV6 = struct.Struct("!BBHI")
VERSION = 6
MIN_MTU = 1280
HOP_LIMIT = 64
HOP_BY_HOP, ROUTING, FRAGMENT, DESTINATION, ICMPV6_PROTOCOL = 0, 43, 44, 60, 58
EXTENSIONS = (HOP_BY_HOP, ROUTING, DESTINATION)  # each says its own length in units of 8 bytes
FRAGMENT_BYTES, FRAGMENT_OFFSET = 8, 0xFFF8
UNREACHABLE = 1  # ICMPv6 type: destination unreachable (RFC 4443, 3.1)
FIRST_INFORMATIONAL = 128  # ICMPv6 types below are errors
CODES: Mapping[Unreachable, int] = MappingProxyType(
    {
        Unreachable.NETWORK: 0,  # no route
        Unreachable.PROHIBITED: 1,
        Unreachable.HOST: 3,  # address unreachable
        Unreachable.HOST_UNKNOWN: 3,
        Unreachable.PORT: 4,
    }
)
QUOTED_BYTES = MIN_MTU - HEADER.size - ICMPV6.size  # of what was lost


def packet_bytes(data: bytes, most: int) -> int | None:
    """Return the length of the packet that data begins with, None if its header is not whole.

    Raise MalformedPacket if it is longer than `most` bytes.
    """
    if len(data) < HEADER.size:
        return None
    total = HEADER.size + int.from_bytes(data[4:6])
    if total > most:
        raise MalformedPacket(f"IPv6 packet of {total} bytes, at most {most} are taken")
    return total


def decode(data: bytes) -> Packet:
    _flow, _length, following, _hops, source, destination = HEADER.unpack_from(data)
    protocol, at, first = _carried(data, following)
    body = data[at : at + 1]
    is_error = protocol == ICMPV6_PROTOCOL and (not body or body[0] < FIRST_INFORMATIONAL)
    return Packet(
        data, IPv6Address(source), IPv6Address(destination), protocol, first, at, is_error
    )


def _carried(data: bytes, following: int) -> tuple[int, int, bool]:
    """Return protocol and place of what is carried, and whether it is whole, or a first fragment.

    Extension headers that are cut short carry themselves.
    """
    at, first = HEADER.size, True
    while following in (*EXTENSIONS, FRAGMENT) and at + FRAGMENT_BYTES <= len(data):
        if following == FRAGMENT:
            first = first and not int.from_bytes(data[at + 2 : at + 4]) & FRAGMENT_OFFSET
            length = FRAGMENT_BYTES
        else:
            length = 8 * (1 + data[at + 1])
        following, at = data[at], at + length
    return following, at, first


def unreachable(lost: Packet, why: Unreachable, router: IPv4Address | IPv6Address) -> bytes:
    here, source = router.packed, lost.source.packed
    quoted = lost.data[:QUOTED_BYTES]
    length = ICMPV6.size + len(quoted)
    summed = PSEUDO_HEADER.pack(here, source, length, ICMPV6_PROTOCOL)
    check = checksum(summed + ICMPV6.pack(UNREACHABLE, CODES[why], 0, 0) + quoted)
    header = HEADER.pack(VERSION << 28, length, ICMPV6_PROTOCOL, HOP_LIMIT, here, source)
    return header + ICMPV6.pack(UNREACHABLE, CODES[why], check, 0) + quoted
