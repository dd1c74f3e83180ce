"""The seal on a host's LLDP: proof of who announces a fibre.

It is the last TLV of ours in a frame (wire.lldp):

    +---------+--------+----------------+
    | subtype | number | HMAC, 16 bytes |   u8, u64; network byte order
    +---------+--------+----------------+

The HMAC (SHA-256, cut to 16 bytes) is under the host's device key and covers the TLVs before it and
the number: the host's clock in nanoseconds, which rises. What was heard once is no use.

Hosts go on to announce their fibres, the more fibres a network has the more rarely: the controller
takes all of it in.
"""

import hmac
import struct

from wire.malformed import MalformedPacket

SPEAKER = b"fibre"  # no datagram or verdict under the same key begins so
TAG_BYTES = 16
PERIOD_S = 5.0  # between two announcements on a fibre, of a small network
LONGEST_PERIOD_S = 30.0  # of any, the default of IEEE 802.1AB (msgTxInterval)
MOST_PER_S = 25  # fibres that hosts announce, in all, up to that
_SEAL = struct.Struct(f"!Q{TAG_BYTES}s")


def period_s(fibers: int) -> float:
    """Return how long a host waits between two announcements where there are so many fibres."""
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
