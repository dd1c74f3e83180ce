"""The message by which a key manager hands keys to the next one of a route.

Each hop hides the keys by a one-time pad: XOR with keys that its two ends have stored. A further
stored key authenticates the message (Wegman and Carter), so that nothing rests on TLS alone. The
manager in between opens the pad, and makes another: it knows the keys.

{"message": the text below, "tag": base64}
{"master_SAE_ID": …, "slave_SAE_IDs": [...], "issued_ns": …, "void": [ids of stored keys that nobody
 will get], "hops": [{"node": address, "tag": base64}], "keys": [{"key_ID": …, "size": bits}],
 "authenticated_by": id of a stored key, "stored": [ids of those of the pad], "masked": base64}
"""

import base64
import json
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address
from uuid import UUID

from applications.keys.key_assignment import MAX_ASSIGNMENT, MAX_BITS, MAX_STORED
from applications.keys.key_delivery import (
    MAX_DEPTH,
    MAX_IDS,
    MAX_NAMES,
    decode_base64,
    decode_id,
    decode_name,
)
from applications.keys.route_messages import MAX_HOPS, TAG_BYTES, Hop
from wire.bounded_json import decode_json
from wire.malformed import MalformedPacket

RELAY_PATH = "/qmn/relays"


@dataclass(frozen=True)
class Relay:
    """Keys on their way from the host of a master to that of its slaves."""

    master: str
    slaves: tuple[str, ...]
    issued_ns: int  # of the route
    hops: tuple[Hop, ...]
    keys: tuple[tuple[UUID, int], ...]  # id and bits of each
    authenticated_by: UUID
    stored: tuple[UUID, ...]
    masked: bytes  # all keys one after the other, XOR what is stored
    void: tuple[UUID, ...] = ()

    @property
    def nodes(self) -> tuple[str, ...]:
        return tuple(hop.node for hop in self.hops)

    def encode(self) -> bytes:
        return json.dumps(
            {
                "master_SAE_ID": self.master,
                "slave_SAE_IDs": self.slaves,
                "issued_ns": self.issued_ns,
                "void": [str(each) for each in self.void],
                "hops": [{"node": hop.node, "tag": _base64(hop.tag)} for hop in self.hops],
                "keys": [{"key_ID": str(key_id), "size": size} for key_id, size in self.keys],
                "authenticated_by": str(self.authenticated_by),
                "stored": [str(each) for each in self.stored],
                "masked": _base64(self.masked),
            }
        ).encode()

    @classmethod
    def decode(cls, text: bytes) -> "Relay":
        """Return what a text relays; raise MalformedPacket if it is not one."""
        match decode_json(text, MAX_ASSIGNMENT, MAX_DEPTH):
            case {
                "master_SAE_ID": master,
                "slave_SAE_IDs": list(slaves),
                "issued_ns": int(issued_ns),
                "void": list(void),
                "hops": list(hops),
                "keys": list(keys),
                "authenticated_by": authenticated_by,
                "stored": list(stored),
                "masked": masked,
                **others,
            } if (
                not others
                and 0 < len(slaves) <= MAX_NAMES + 1
                and 0 < len(keys) <= MAX_IDS
                and 2 <= len(hops) <= MAX_HOPS
                and 0 <= issued_ns < 1 << 64
            ):
                relay = cls(
                    decode_name(master),
                    tuple(decode_name(slave) for slave in slaves),
                    int(issued_ns),
                    tuple(_hop(hop) for hop in hops),
                    tuple(_key(key) for key in keys),
                    decode_id(authenticated_by),
                    tuple(decode_id(each) for each in stored),
                    decode_base64(masked),
                    tuple(decode_id(each) for each in void),
                )
            case _:
                raise MalformedPacket("no relay of keys")
        _check(relay)
        return relay


def encode_sealed(text: bytes, tag: bytes) -> bytes:
    return json.dumps({"message": text.decode(), "tag": _base64(tag)}).encode()


def decode_sealed(body: bytes) -> tuple[bytes, bytes]:
    """Return text and tag of a body; raise MalformedPacket if it has none."""
    match decode_json(body, MAX_ASSIGNMENT, MAX_DEPTH):
        case {"message": str(text), "tag": tag, **others} if not others:
            decoded = decode_base64(tag)
            if text.isascii() and len(decoded) == TAG_BYTES:
                return text.encode(), decoded
    raise MalformedPacket("no message with a tag")


def _check(relay: Relay) -> None:
    stored = (relay.authenticated_by, *relay.stored, *relay.void)
    if len(stored) > MAX_STORED or len(set(stored)) < len(stored):
        raise MalformedPacket(f"stored keys: each once, {MAX_STORED} at most")
    if len({key_id for key_id, _size in relay.keys}) < len(relay.keys):
        raise MalformedPacket("a key_ID is relayed twice")
    if len(relay.masked) != sum(size for _key_id, size in relay.keys) // 8:
        raise MalformedPacket(f"{len(relay.masked)} bytes are not those of the keys")
    if len(set(relay.nodes)) < len(relay.hops):
        raise MalformedPacket("a route comes to a host twice")


def _hop(fields: object) -> Hop:
    match fields:
        case {"node": str(node), "tag": tag, **others} if not others:
            decoded = decode_base64(tag)
            try:
                address = str(IPv4Address(node))
            except AddressValueError as error:
                raise MalformedPacket(f"no address: {error}") from error
            if len(decoded) == TAG_BYTES:
                return Hop(address, decoded)
    raise MalformedPacket("no hop of a route")


def _key(fields: object) -> tuple[UUID, int]:
    match fields:
        case {"key_ID": key_id, "size": int(size), **others} if (
            not others and not isinstance(size, bool) and 0 < size <= MAX_BITS and size % 8 == 0
        ):
            return decode_id(key_id), int(size)
    raise MalformedPacket("no relayed key")


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
