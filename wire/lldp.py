"""LLDP (IEEE 802.1AB) on the fibres' supervisory channel: who is at the other end of a fibre.

A host names one of its fibre ports: chassis id = host name, port id = interface name (both locally
assigned), management address = IPv4 address of the host's CNIC; what the host can do:
wire.features; an announcement is sealed by the host (below).

A switch says what its controller has it say: chassis id = dpid:0123456789abcdef (locally assigned),
port id = number (port component), as the frameworks' own topology app writes them, and a seal that
the controller alone can make.

Ours are organizationally specific TLVs, OUI and subtype before what they hold.

The seal on a host's LLDP: proof of who announces a fibre.

It is the last TLV of ours in a frame (wire.lldp):

    +---------+--------+----------------+
    | subtype | number | HMAC, 16 bytes |   u8, u64; network byte order
    +---------+--------+----------------+

The HMAC (SHA-256, cut to 16 bytes) is under the host's device key and covers the TLVs before it and
the number: the host's clock in nanoseconds, which rises. An old announcement is no use.

Hosts go on to announce their fibres, the more fibres a network has the more rarely: the controller
takes all of it in.
"""

import hmac
import struct
from ipaddress import IPv4Address

from wire.features import NodeFeatures
from wire.malformed import MalformedPacket

SPEAKER = b"fibre"  # no datagram or verdict under the same key begins so
TAG_BYTES = 16
PERIOD_S = 5.0  # between two announcements on a fibre, of a small network
LONGEST_PERIOD_S = 30.0  # of any, the default of IEEE 802.1AB (msgTxInterval)
MOST_PER_S = 25  # fibres that hosts announce, in all, up to that
_SEAL = struct.Struct(f"!Q{TAG_BYTES}s")


def period_s(fibers: int) -> float:
    return min(max(PERIOD_S, fibers / MOST_PER_S), LONGEST_PERIOD_S)


def seal(tlvs: bytes, key: str, number: int) -> bytes:
    """Return what the TLV holds behind OUI and subtype; the key is hexadecimal."""
    return _SEAL.pack(number, _tag(tlvs, key, number))


def open_seal(data: bytes, tlvs: bytes, key: str) -> int:
    """Return the number of an announcement; raise MalformedPacket unless the key's host made it."""
    if len(data) != _SEAL.size:
        raise MalformedPacket(f"the seal of an announcement has {len(data)} bytes")
    number, tag = _SEAL.unpack(data)
    if not hmac.compare_digest(tag, _tag(tlvs, key, number)):
        raise MalformedPacket("the seal of an announcement is wrong")
    return int(number)


def _tag(tlvs: bytes, key: str, number: int) -> bytes:
    covered = SPEAKER + struct.pack("!Q", number) + tlvs
    return hmac.digest(bytes.fromhex(key), covered, "sha256")[:TAG_BYTES]


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
