"""The LLDP frame by which a host names one of its fibre ports.

IEEE 802.1AB: chassis id = host name, port id = interface name (both locally assigned),
management address = IPv4 address of the host's CNIC; what the host can do: wire.features; that
it is the host that says so: wire.announcement.
"""

import struct
from ipaddress import IPv4Address

from wire.announcement import SUBTYPE as SEAL_SUBTYPE
from wire.announcement import seal
from wire.features import OUI, SUBTYPE, NodeFeatures

NEAREST_BRIDGE = bytes.fromhex("0180c200000e")
ETHER_TYPE = 0x88CC
MIN_FRAME_BYTES = 60  # of Ethernet, without the check sequence
END, CHASSIS_ID, PORT_ID, TTL, MANAGEMENT_ADDRESS, ORGANIZATIONAL = 0, 1, 2, 3, 8, 127  # types
LOCALLY_ASSIGNED = b"\x07"
IPV4 = 1  # IANA address family number
UNKNOWN_INTERFACE = 1


def announcement(
    name: str,
    port: str,
    address: str,
    mac: bytes,
    ttl_s: int,
    node_features: NodeFeatures,
    key: str = "",
    number: int = 0,
) -> bytes:
    """Return the frame of one fibre port; what it says holds for `ttl_s` seconds.

    It is sealed with the device key, if there is one; numbers rise from frame to frame.
    """
    management = struct.pack(
        "!BB4sBIB", 5, IPV4, IPv4Address(address).packed, UNKNOWN_INTERFACE, 0, 0
    )
    tlvs = b"".join(
        (
            _tlv(CHASSIS_ID, LOCALLY_ASSIGNED + name.encode()),
            _tlv(PORT_ID, LOCALLY_ASSIGNED + port.encode()),
            _tlv(TTL, struct.pack("!H", ttl_s)),
            _tlv(MANAGEMENT_ADDRESS, management),
            _tlv(ORGANIZATIONAL, OUI + bytes([SUBTYPE]) + node_features.encode()),
        )
    )
    if key:
        told = bytes([SEAL_SUBTYPE]) + seal(tlvs, key, number)
        tlvs += _tlv(ORGANIZATIONAL, OUI + told)
    frame = NEAREST_BRIDGE + mac + struct.pack("!H", ETHER_TYPE) + tlvs + _tlv(END, b"")
    return frame.ljust(MIN_FRAME_BYTES, b"\0")


def _tlv(kind: int, value: bytes) -> bytes:
    """Return type (7 bits), length (9 bits) and value."""
    return struct.pack("!H", kind << 9 | len(value)) + value
