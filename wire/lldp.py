"""LLDP (IEEE 802.1AB) on the fibres' supervisory channel: who is at the other end of a fibre.

A host names one of its fibre ports: chassis id = host name, port id = interface name (both locally
assigned), management address = IPv4 address of the host's CNIC; what the host can do:
wire.features; that it is the host that says so: wire.announcement.

A switch says what its controller has it say: chassis id = dpid:0123456789abcdef (locally assigned),
port id = number (port component), as the frameworks' own topology app writes them, and a seal that
the controller alone can make.

Ours are organizationally specific TLVs, OUI and subtype before what they hold.
"""

import struct
from ipaddress import IPv4Address

from wire.announcement import seal
from wire.features import NodeFeatures

OUI = b"\x02QM"  # locally administered
SWITCH_SEAL, FEATURES, HOST_SEAL = 1, 2, 3  # subtypes
NEAREST_BRIDGE = bytes.fromhex("0180c200000e")
ETHER_TYPE = 0x88CC
MIN_FRAME_BYTES = 60  # of Ethernet, without the check sequence
END, CHASSIS_ID, PORT_ID, TTL, MANAGEMENT_ADDRESS, ORGANIZATIONAL = 0, 1, 2, 3, 8, 127  # types
PORT_COMPONENT, LOCALLY_ASSIGNED = 2, 7  # subtypes of ids; the latter of chassis and ports
SWITCH_PREFIX = b"dpid:"
SWITCH_PORT = struct.Struct("!I")
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
            _tlv(CHASSIS_ID, bytes([LOCALLY_ASSIGNED]) + name.encode()),
            _tlv(PORT_ID, bytes([LOCALLY_ASSIGNED]) + port.encode()),
            _tlv(TTL, struct.pack("!H", ttl_s)),
            _tlv(MANAGEMENT_ADDRESS, management),
            _ours(FEATURES, node_features.encode()),
        )
    )
    if key:
        tlvs += _ours(HOST_SEAL, seal(tlvs, key, number))
    return _frame(mac, tlvs).ljust(MIN_FRAME_BYTES, b"\0")


def switch_message(dpid: int, port: int, mac: bytes, ttl_s: int, proof: bytes) -> bytes:
    chassis = bytes([LOCALLY_ASSIGNED]) + SWITCH_PREFIX + b"%016x" % dpid
    tlvs = (
        _tlv(CHASSIS_ID, chassis),
        _tlv(PORT_ID, bytes([PORT_COMPONENT]) + SWITCH_PORT.pack(port)),
        _tlv(TTL, struct.pack("!H", ttl_s)),
        _ours(SWITCH_SEAL, proof),
    )
    return _frame(mac, b"".join(tlvs))


def _frame(mac: bytes, tlvs: bytes) -> bytes:
    return NEAREST_BRIDGE + mac + struct.pack("!H", ETHER_TYPE) + tlvs + _tlv(END, b"")


def _ours(subtype: int, value: bytes) -> bytes:
    return _tlv(ORGANIZATIONAL, OUI + bytes([subtype]) + value)


def _tlv(kind: int, value: bytes) -> bytes:
    """Return type (7 bits), length (9 bits) and value."""
    return struct.pack("!H", kind << 9 | len(value)) + value
