"""UDP over IPv4 in Ethernet frames: what the controller sends to and hears from node agents."""

import struct
from dataclasses import dataclass
from ipaddress import IPv4Address

from controller_apps.packets.segments import ETHERNET_LENGTH, checksum
from wire.device import DEVICE_PORT
from wire.malformed import MalformedPacket

IP_UDP = 17
LLDP = b"\x88\xcc"  # EtherType
TTL = 64
CONTROLLER_MAC = bytes.fromhex("02514d000001")  # locally administered
_IP = struct.Struct("!BBHHHBBH4s4s")
_UDP = struct.Struct("!HHHH")


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
        ends = IPv4Address(self.source).packed, IPv4Address(self.destination).packed
        length = _UDP.size + len(self.payload)
        fields = 0x45, 0, _IP.size + length, 0, 0x4000, TTL, IP_UDP
        ip = _IP.pack(*fields, checksum(_IP.pack(*fields, 0, *ends)), *ends)
        ports = self.source_port, self.destination_port
        pseudo_header = b"".join(ends) + struct.pack("!HH", IP_UDP, length)
        summed = pseudo_header + _UDP.pack(*ports, length, 0) + self.payload
        udp = _UDP.pack(*ports, length, checksum(summed) or 0xFFFF)
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


def is_announcement(frame: bytes) -> bool:
    """Tell whether a frame is LLDP, or an agent's announcement of its node."""
    if frame[12:14] == LLDP:
        return True
    try:
        return Frame.decode(frame).destination_port == DEVICE_PORT
    except MalformedPacket:
        return False
