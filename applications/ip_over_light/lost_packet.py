"""An IP packet as who carries it sees it, and why it may be lost."""

import struct
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import IPv4Address, IPv6Address

BROADCAST = IPv4Address("255.255.255.255")


class Unreachable(IntEnum):
    """Why a destination cannot be reached: the codes of ICMP (RFC 792; RFC 1812, 5.2.7.1)."""

    NETWORK = 0
    HOST = 1
    PORT = 3
    HOST_UNKNOWN = 7
    PROHIBITED = 13  # communication administratively prohibited


@dataclass(frozen=True)
class Packet:
    """One packet, whole; `data` are its bytes, header and all."""

    data: bytes
    source: IPv4Address | IPv6Address
    destination: IPv4Address | IPv6Address
    protocol: int  # of what it carries
    first: bool  # whether it is whole, or a first fragment
    header_bytes: int  # to what it carries
    is_error: bool  # of ICMP, which must not be answered with another

    @property
    def may_be_answered(self) -> bool:
        """Whether an ICMP error may tell its sender that it is lost.

        RFC 1122, 3.2.2; RFC 4443, 2.4 (e).
        """
        to_many = self.destination.is_multicast or self.destination == BROADCAST
        nobody = self.source.is_multicast or self.source.is_unspecified or self.source.is_loopback
        if not self.first or to_many or nobody or self.source == BROADCAST:
            return False
        return not self.is_error


def checksum(data: bytes) -> int:
    """Return the Internet checksum (RFC 1071); 0 for data that contain their own right one."""
    padded = data + bytes(len(data) % 2)
    total: int = sum(struct.unpack(f"!{len(padded) // 2}H", padded))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF
