"""Datagrams between the controller and key managers: what links have, and by whom keys are relayed.

They travel in the envelope of wire.device, sealed with the device key of the manager's host:

controller, UDP port DEVICE_PORT      key manager, UDP port KEY_AGENT_PORT
                                  <-  KeyLinks: the links of its host, now and then
                                  <-  KeyRouteRequest: by whom can keys come to that host?
KeyRoute, or Answer: why not      ->

A route carries a tag for each host that it names but the first: an HMAC with that host's device
key, by which it knows that the controller has chosen this route, and when.
"""

import hmac
import struct
from collections.abc import Sequence
from dataclasses import dataclass, fields
from ipaddress import IPv4Address

from wire.malformed import MalformedPacket
from wire.metadata.header import Elements, Message, padded_name

KEY_AGENT_PORT = 9018
FROM_KEY_MANAGER, TO_KEY_MANAGER = b"key manager", b"controller to key manager"
MAX_LINKS = 48  # of one host
MAX_HOPS = 16
MAX_SAE = 64  # bytes
TAG_BYTES = 16
ROUTE_S = 10.0  # of the wall clock, or of stepped time: how long a route may be used
UNKNOWN = 0xFFFFFFFF
LINK = struct.Struct("!4sIIIII?")
HOP = struct.Struct(f"!4s{TAG_BYTES}s")


@dataclass(frozen=True)
class LinkState:
    """The keys that a host shares with another, and how the last sessions went."""

    peer: str  # IPv4 address
    mine: int  # stored keys that this end hands out first
    theirs: int
    capacity: int  # keys that its store has room for, of both
    rate_bps: int  # secret key made, bits a second
    qber_ppm: int = UNKNOWN  # of the last session that has reported it
    withheld: bool = False  # whether no key goes out, for too many errors


LINK_NAMES = tuple(field.name for field in fields(LinkState))


@dataclass(frozen=True)
class KeyLinks(Message):
    KIND = 37
    ELEMENTS = Elements("links", LINK, LINK_NAMES, 0, MAX_LINKS)
    FIELDS = struct.Struct("!")

    links: tuple[LinkState, ...] = ()

    def encode(self) -> bytes:
        return self._frame(b"".join(_pack_link(link) for link in self.links))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "KeyLinks":
        count, rest = divmod(len(body), LINK.size)
        if rest or count > MAX_LINKS:
            raise MalformedPacket(f"KeyLinks: {len(body)} bytes do not fit")
        rows = LINK.iter_unpack(body)
        return cls(session, tuple(LinkState(_address(peer), *more) for peer, *more in rows))


@dataclass(frozen=True)
class KeyRouteRequest(Message):
    """Ask for the route of this number of keys to another host, and for its applications."""

    KIND = 38
    FIELDS = struct.Struct(f"!4sI{MAX_SAE}s{MAX_SAE}s")

    target: str  # IPv4 address
    stored: int  # keys that every hop takes from its store
    master: str  # SAE IDs
    slave: str

    def encode(self) -> bytes:
        target = IPv4Address(self.target).packed
        return self._frame(
            self.FIELDS.pack(target, self.stored, self.master.encode(), self.slave.encode())
        )

    @classmethod
    def parse(cls, session: int, body: bytes) -> "KeyRouteRequest":
        if len(body) != cls.FIELDS.size:
            raise MalformedPacket(f"KeyRouteRequest: {len(body)} bytes, not {cls.FIELDS.size}")
        target, stored, master, slave = cls.FIELDS.unpack(body)
        return cls(session, _address(target), stored, padded_name(master), padded_name(slave))


@dataclass(frozen=True)
class Hop:
    """A host of a route, and the controller's word for it."""

    node: str  # IPv4 address
    tag: bytes = bytes(TAG_BYTES)  # of the first, who asks: nothing


@dataclass(frozen=True)
class KeyRoute(Message):
    """By whom keys go; two hops are a direct link."""

    KIND = 39
    ELEMENTS = Elements("hops", HOP, ("node", "tag"), 2, MAX_HOPS)
    FIELDS = struct.Struct("!QI")

    issued_ns: int  # by the controller's clock
    stored: int  # keys that the poorest of its links has
    hops: tuple[Hop, ...] = ()

    @property
    def nodes(self) -> tuple[str, ...]:
        return tuple(hop.node for hop in self.hops)

    def encode(self) -> bytes:
        hops = (HOP.pack(IPv4Address(hop.node).packed, hop.tag) for hop in self.hops)
        return self._frame(self.FIELDS.pack(self.issued_ns, self.stored) + b"".join(hops))

    @classmethod
    def parse(cls, session: int, body: bytes) -> "KeyRoute":
        count, rest = divmod(len(body) - cls.FIELDS.size, HOP.size)
        if rest or not 2 <= count <= MAX_HOPS:
            raise MalformedPacket(f"KeyRoute: {len(body)} bytes do not fit")
        issued_ns, stored = cls.FIELDS.unpack_from(body)
        rows = HOP.iter_unpack(body[cls.FIELDS.size :])
        hops = tuple(Hop(_address(node), tag) for node, tag in rows)
        return cls(session, issued_ns, stored, hops)


def route_tag(key: str, issued_ns: int, nodes: Sequence[str]) -> bytes:
    path = b"".join(IPv4Address(node).packed for node in nodes)
    data = b"key route" + issued_ns.to_bytes(8, "big") + path
    return hmac.digest(bytes.fromhex(key), data, "sha256")[:TAG_BYTES]


def _pack_link(link: LinkState) -> bytes:
    peer, *more = vars(link).values()
    return LINK.pack(IPv4Address(peer).packed, *more)


def _address(packed: bytes) -> str:
    return str(IPv4Address(packed))
