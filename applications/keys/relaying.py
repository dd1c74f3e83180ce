"""Keys relayed hop by hop: hidden by a one-time pad and authenticated at each, along a route.

    KME of a                 KME of r                     KME of b
    keys XOR pad(a, r) --->  opens, keys XOR pad(r, b) --->  opens, keeps them for its SAE

r knows the keys: it must be trusted, and the controller says with a tag of its own for r that it
is, for this route and for so long. The pads are stored keys, each used once; a message is
authenticated by a stored key of its own (Wegman and Carter), besides the TLS that carries it.
"""

from collections.abc import Awaitable, Callable, Sequence
from hmac import compare_digest
from uuid import UUID

from applications.keys.config import KeyManagerConfig, manager_name
from applications.keys.key_delivery import DeliveredKey
from applications.keys.key_relay import Relay, decode_sealed, encode_sealed
from applications.keys.refusals import Refused, bad_request, unauthorized, unavailable
from applications.keys.route_messages import ROUTE_S, KeyRoute, route_tag
from applications.keys.stored_keys import StoredKeys
from applications.qkd.authentication import PAD_BYTES, POINT_BYTES, Authenticator, KeyPool
from applications.qkd.key_store import KEY_BITS

NS = 1e9
Send = Callable[[str, bytes], Awaitable[None]]  # a body to a host's key manager; raises Refused
Keep = Callable[[str, Sequence[str], Sequence[DeliveredKey]], None]  # for slaves here


def stored_for(number: int, size: int) -> int:
    """Return how many stored keys each hop takes for a number of keys of a size."""
    return 1 + -(-number * (size // 8) // (KEY_BITS // 8))


class Relaying:
    """Hands keys on, and takes those that are handed on."""

    def __init__(
        self, config: KeyManagerConfig, stored: StoredKeys, send: Send, keep: Keep
    ) -> None:
        self._config, self._stored, self._send, self._keep = config, stored, send, keep
        self._hosts = {address: host for host, address in config.hosts.items()}
        self._time = config.time

    async def send(
        self, route: KeyRoute, master: str, slaves: Sequence[str], keys: Sequence[DeliveredKey]
    ) -> None:
        """Send keys along a route that begins here; Refused if they have not come to its end."""
        if len(route.nodes) < 2 or route.nodes[0] != self._config.address:
            raise unavailable(f"the controller's route {route.nodes} does not begin here")
        sizes = tuple((key.key_id, 8 * len(key.key)) for key in keys)
        plain = b"".join(key.key for key in keys)
        unsent = Relay(
            master, tuple(slaves), route.issued_ns, route.hops, sizes, UUID(int=0), (), b""
        )
        await self._hand_on(unsent, plain, 0)

    async def accept(self, manager: str, body: bytes) -> None:
        """Take a message of the manager before; Refused or MalformedPacket changes nothing more."""
        text, tag = decode_sealed(body)
        relay = Relay.decode(text)
        place = self._place(manager, relay)
        before = self._hosts[relay.nodes[place - 1]]
        for unwanted in relay.void:
            self._stored.discard(before, unwanted)
        ids = [relay.authenticated_by, *relay.stored]
        authenticating, *pads = await self._stored.taken_by_id(before, ids)
        if not compare_digest(_tag(authenticating, text), tag):
            raise bad_request("the tag does not fit the message")
        plain = _xor(relay.masked, b"".join(pads))
        if place + 1 < len(relay.nodes):
            await self._hand_on(relay, plain, place)
        else:
            self._deliver(relay, plain)

    def _place(self, manager: str, relay: Relay) -> int:
        """Return where in the route this host is; Refused without word of the controller."""
        nodes = relay.nodes
        place = nodes.index(self._config.address) if self._config.address in nodes else 0
        if not place or not all(node in self._hosts for node in nodes):
            raise unauthorized()
        if manager_name(self._hosts[nodes[place - 1]]) != manager:
            raise unauthorized()
        tag = route_tag(self._config.device_key, relay.issued_ns, nodes)
        if not compare_digest(tag, relay.hops[place].tag):
            raise unauthorized()
        if abs(self._time.stamp_ns() - relay.issued_ns) > ROUTE_S * NS:
            raise bad_request(f"the route is older than {ROUTE_S:g} s: ask for another")
        ends = self._hosts[nodes[0]], self._hosts[nodes[-1]]
        places = [self._config.saes.get(name) for name in (relay.master, *relay.slaves)]
        if places != [ends[0], *[ends[1]] * len(relay.slaves)]:
            raise unauthorized()
        return place

    async def _hand_on(self, relay: Relay, plain: bytes, place: int) -> None:
        """Hide keys for the next hop, and send them there."""
        host = self._hosts[relay.nodes[place + 1]]
        self._stored.require_given_out(host)
        count = -(-len(plain) // (KEY_BITS // 8))
        authenticating, *pads = await self._stored.taken(host, 1 + count)
        void = self._stored.void(host)
        following = Relay(
            relay.master,
            relay.slaves,
            relay.issued_ns,
            relay.hops,
            relay.keys,
            authenticating.key_id,
            tuple(pad.key_id for pad in pads),
            _xor(plain, b"".join(pad.key for pad in pads)),
            void,
        )
        text = following.encode()
        try:
            await self._send(host, encode_sealed(text, _tag(authenticating.key, text)))
        except Refused:
            self._stored.lose(host, [*void, following.authenticated_by, *following.stored])
            raise

    def _deliver(self, relay: Relay, plain: bytes) -> None:
        keys, start = [], 0
        for key_id, size in relay.keys:
            keys.append(DeliveredKey(key_id, plain[start : start + size // 8]))
            start += size // 8
        self._keep(relay.master, relay.slaves, keys)


def _tag(key: bytes, text: bytes) -> bytes:
    return Authenticator(KeyPool(key[: POINT_BYTES + PAD_BYTES])).tag(text)


def _xor(data: bytes, pad: bytes) -> bytes:
    if len(pad) < len(data):
        raise bad_request(f"{len(pad)} bytes of pad hide no {len(data)} bytes")
    return bytes(a ^ b for a, b in zip(data, pad[: len(data)], strict=True))
