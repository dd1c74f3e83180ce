"""IP packets of both versions, back to back in a stream, and the ICMP errors that one is lost.

Their own length says where each ends, so that the stream needs nothing between them. Bytes that
cannot be a packet end the stream: nobody knows where the next one begins.
"""

from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address

from applications.ip_over_light import ipv4, ipv6
from applications.ip_over_light.lost_packet import Packet, Unreachable
from wire.malformed import MalformedPacket


@dataclass(frozen=True)
class Version:
    """A version of IP, by what it can tell and say."""

    packet_bytes: Callable[[bytes, int], int | None]
    decode: Callable[[bytes], Packet]
    unreachable: Callable[[Packet, Unreachable, IPv4Address | IPv6Address], bytes]


VERSIONS = {
    each.VERSION: Version(each.packet_bytes, each.decode, each.unreachable) for each in (ipv4, ipv6)
}


def packet_bytes(data: bytes, most: int) -> int | None:
    """Return the length of the packet that data begins with, None if its header is not whole.

    Raise MalformedPacket if it is not one, or longer than `most` bytes.
    """
    return _version_of(data).packet_bytes(data, most) if data else None


def decode(data: bytes, most: int) -> Packet:
    """Return one whole packet; raise MalformedPacket if the data are not exactly that."""
    if packet_bytes(data, most) != len(data):
        raise MalformedPacket(f"{len(data)} bytes are not one IP packet")
    return _version_of(data).decode(data)


class PacketStream:
    """Bytes of a stream, as they come, into packets."""

    def __init__(self, most: int) -> None:
        """Begin; no packet may have more than `most` bytes."""
        self._most = most
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that are whole now; raise MalformedPacket for anything else."""
        self._rest += data
        packets = []
        at = 0
        head = ipv6.HEADER.size  # of the longer one
        while (total := packet_bytes(self._rest[at : at + head], self._most)) is not None:
            if at + total > len(self._rest):
                break
            packets.append(decode(self._rest[at : at + total], self._most))
            at += total
        self._rest = self._rest[at:]
        return packets


def unreachable(lost: Packet, why: Unreachable, router: IPv4Address | IPv6Address) -> bytes:
    """Return the packet by which a router tells the sender of another that it is lost.

    The router's address is of the packet's version.
    """
    return VERSIONS[lost.source.version].unreachable(lost, why, router)


def _version_of(data: bytes) -> Version:
    version = data[0] >> 4
    if version not in VERSIONS:
        raise MalformedPacket(f"IP version {version}: only 4 and 6 go over light")
    return VERSIONS[version]
