"""Key managers in a row, with the controller's own choice of a route, and nothing else between."""

import os
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from applications.keys.config import KeyLink, KeyManagerConfig, manager_name
from applications.keys.delivery import KeyDelivery
from applications.keys.key_delivery import KeyRequest
from applications.keys.key_network import KeyNetwork, NoRoute
from applications.keys.key_relay import Relay, decode_sealed, encode_sealed
from applications.keys.link_states import KeyLinkStates
from applications.keys.refusals import Refused, unavailable
from applications.keys.route_messages import ROUTE_S, Hop, KeyRoute, KeyRouteRequest, route_tag
from applications.qkd.key_store import StoredKey
from controller_apps.policy.reading import parse_policy
from hosts import network_loop
from wire.malformed import MalformedPacket

HOSTS = {"alice": "10.0.0.1", "bob": "10.0.0.2", "r1": "10.0.0.11", "r2": "10.0.0.12"}
NAMES = {address: host for host, address in HOSTS.items()}
SAES = {"a": "alice", "b": "bob", "b2": "bob", "r": "r1"}
KEYS = {host: f"{number:02x}" * 16 for number, host in enumerate(HOSTS)}
LINKS = ("alice", "r1"), ("r1", "r2"), ("r2", "bob")
STORED = 8  # keys of each direction of each link
TRUSTED = '[[trusted]]\nhost = "r1"\n[[trusted]]\nhost = "r2"\nbetween = ["bob", "alice"]'


@pytest.fixture(autouse=True)
def _nothing_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what only a power cut or a slow session would show."""
    monkeypatch.setattr(os, "fsync", lambda _file: None)
    monkeypatch.setattr("applications.keys.stored_keys.STORING_TIMEOUT_S", 0.0)


class Row:
    """Key managers whose messages go from one to the next as bytes, which a test may change."""

    def __init__(self, folder: Path, policy: str = TRUSTED) -> None:
        folder.chmod(0o700)
        self.network = KeyNetwork(NAMES, parse_policy(policy))
        self.bodies: list[tuple[str, str, bytes]] = []  # from, to, and what
        self.change: Callable[[bytes], bytes] = bytes
        self.configs = {host: self._config(folder, host) for host in HOSTS}
        self.of = {host: self._manager(host) for host in HOSTS}
        for one, other in LINKS:
            self.fill(one, other)

    def _config(self, folder: Path, host: str) -> KeyManagerConfig:
        peers = [KeyLink(a if b == host else b, a == host) for a, b in LINKS if host in (a, b)]
        return KeyManagerConfig(
            host=host,
            address=HOSTS[host],
            keys=str(folder / host),
            hosts=HOSTS,
            saes=SAES,
            device_key=KEYS[host],
            links=peers,
            certificate="",
            private_key="",
            authority="",
            stack="",
        )

    def _manager(self, host: str) -> KeyDelivery:
        async def tell(_to: str, _assignment: Any) -> None:
            raise unavailable("no assignment goes to a host without a link")

        async def send(to: str, body: bytes) -> None:
            self.bodies.append((host, to, body))
            await self.of[to].accept_relay(manager_name(host), self.change(body))

        manager = KeyDelivery(self.configs[host], tell, send)
        manager.router = Router(self, host)
        return manager

    def fill(self, one: str, other: str) -> None:
        for first in (one, other):
            keys = [StoredKey(uuid4(), os.urandom(32)) for _ in range(STORED)]
            self.of[one].stores[other].put_all(keys, first=first == one)
            self.of[other].stores[one].put_all(keys, first=first == other)

    def left(self, one: str, other: str) -> tuple[int, int]:
        return self.of[one].stores[other].mine, self.of[other].stores[one].theirs


class Router:
    """The controller without its packets: it hears of all links, and answers."""

    def __init__(self, row: Row, host: str) -> None:
        self.row, self.host = row, host

    async def ask(self, host: str, stored: int, master: str, slave: str) -> KeyRoute:
        network, now = self.row.network, 0.0
        for each, manager in self.row.of.items():
            states = KeyLinkStates(self.row.configs[each], manager).all()
            network.take(HOSTS[each], states, now)
        request = KeyRouteRequest(1, HOSTS[host], stored, master, slave)
        try:
            nodes, least = network.serve(HOSTS[self.host], request, now)
        except NoRoute as error:
            raise unavailable(str(error)) from error
        return route(nodes, stored=least)

    async def register(self, host: str, master: str, slave: str) -> None:
        await self.ask(host, 0, master, slave)


def route(nodes: tuple[str, ...], issued_ns: int = 0, stored: int = 0) -> KeyRoute:
    """Return a route with the tags of the controller."""
    issued_ns = issued_ns or time.time_ns()
    hops = [Hop(node, route_tag(KEYS[NAMES[node]], issued_ns, nodes)) for node in nodes]
    return KeyRoute(1, issued_ns, stored, tuple(hops))


def play(folder: Path, scene: Callable[[Row], Awaitable[None]], policy: str = TRUSTED) -> None:
    async def whole() -> None:
        await scene(Row(folder, policy))

    network_loop.run(whole())


@pytest.mark.parametrize(("number", "size"), [(1, 256), (3, 8), (2, 264)])
def test_a_key_comes_to_a_host_without_a_link_over_two_trusted_nodes(
    tmp_path: Path, number: int, size: int
) -> None:
    async def scene(row: Row) -> None:
        keys = await row.of["alice"].get_keys("a", "b", KeyRequest(number, size, ("b2",)))
        ids = [key.key_id for key in keys]
        assert [len(key.key) for key in keys] == [size // 8] * number
        for slave in ("b", "b2"):
            assert row.of["bob"].fetch(slave, "a", ids) == keys
        # A pad as long as the keys and one key for the tag, of every link; none of it twice.
        used = 1 + -(-number * size // 256)
        for one, other in LINKS:
            assert row.left(one, other) == (STORED - used, STORED - used)
        assert [(one, to) for one, to, _body in row.bodies] == list(LINKS)
        for _one, _to, body in row.bodies:
            masked = Relay.decode(decode_sealed(body)[0]).masked
            assert size == 8 or not any(key.key in masked for key in keys)
        assert row.of["r1"].fetch("r", "a", []) == []
        with pytest.raises(Refused):
            row.of["r1"].fetch("r", "a", ids)

    play(tmp_path, scene)


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("", r"r1, r2 could, if \[\[trusted\]\]"),
        ('[[trusted]]\nhost = "r1"', "no host that the policy trusts joins alice and bob"),
        ('[[trusted]]\nhost = "*"\nbetween = ["alice", "r2"]', "no host that the policy trusts"),
    ],
)
def test_nobody_relays_whom_the_policy_does_not_trust(
    tmp_path: Path, policy: str, words: str
) -> None:
    async def scene(row: Row) -> None:
        with pytest.raises(Refused, match=words) as refused:
            await row.of["alice"].get_keys("a", "b", KeyRequest())
        assert refused.value.status == 503
        assert (await row.of["alice"].status("a", "b")).stored_key_count == 0
        assert row.bodies == []

    play(tmp_path, scene, policy)


def test_status_says_what_the_poorest_link_can_give(tmp_path: Path) -> None:
    async def scene(row: Row) -> None:
        row.of["r1"].stores["r2"].take_oldest(3)
        assert (await row.of["alice"].status("a", "b")).stored_key_count == STORED - 4
        with pytest.raises(Refused, match="too few keys are stored between alice and bob for 6"):
            await row.of["alice"].get_keys("a", "b", KeyRequest(5))
        assert row.left("alice", "r1") == (STORED, STORED)

    play(tmp_path, scene)


def test_an_eavesdropper_on_one_link_closes_the_route(tmp_path: Path) -> None:
    async def scene(row: Row) -> None:
        row.of["r1"].withheld["r2"] = "QBER .25"
        with pytest.raises(Refused, match="no chain of key links that are in use"):
            await row.of["alice"].get_keys("a", "b", KeyRequest())

    play(tmp_path, scene)


@pytest.mark.parametrize("nodes", [("10.0.0.1",), ("10.0.0.11", "10.0.0.12", "10.0.0.2")])
def test_a_route_that_has_no_way_from_here_is_refused(
    tmp_path: Path, nodes: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def ask(*_request: Any) -> KeyRoute:
        return route(nodes, stored=STORED)

    async def scene(row: Row) -> None:
        monkeypatch.setattr(row.of["alice"].router, "ask", ask)
        with pytest.raises(Refused, match="does not begin here"):
            await row.of["alice"].get_keys("a", "b", KeyRequest())
        assert row.bodies == []

    play(tmp_path, scene)


def spoiled(body: bytes, place: int) -> bytes:
    text, tag = decode_sealed(body)
    relay = Relay.decode(text)
    masked = bytearray(relay.masked)
    masked[place] ^= 1
    return encode_sealed(replace(relay, masked=bytes(masked)).encode(), tag)


def test_a_message_that_was_changed_is_refused_at_the_next_hop(tmp_path: Path) -> None:
    async def scene(row: Row) -> None:
        row.change = lambda body: spoiled(body, 5)
        with pytest.raises(Refused, match="the tag does not fit the message"):
            await row.of["alice"].get_keys("a", "b", KeyRequest())
        row.change = bytes
        assert len(row.bodies) == 1
        (key,) = await row.of["alice"].get_keys("a", "b", KeyRequest())
        assert row.of["bob"].fetch("b", "a", [key.key_id]) == [key]
        assert row.left("alice", "r1") == (STORED - 4, STORED - 4)

    play(tmp_path, scene)


def test_what_was_said_once_is_no_use_again(tmp_path: Path) -> None:
    async def scene(row: Row) -> None:
        await row.of["alice"].get_keys("a", "b", KeyRequest())
        for one, to, body in row.bodies:
            with pytest.raises(Refused, match="not in the store"):
                await row.of[to].accept_relay(manager_name(one), body)

    play(tmp_path, scene)


def test_a_relay_that_the_controller_has_not_chosen_is_refused(tmp_path: Path) -> None:
    async def scene(row: Row) -> None:
        await row.of["alice"].get_keys("a", "b", KeyRequest())
        _one, _to, body = row.bodies[0]
        text, tag = decode_sealed(body)
        relay = Relay.decode(text)
        nodes = relay.nodes
        long_ago = route(nodes, time.time_ns() - round((ROUTE_S + 1) * 1e9))
        for changed, manager, words in (
            (replace(relay, hops=relay.hops[:-1]), "kme-alice", None),  # another route
            (replace(relay, issued_ns=relay.issued_ns + 1), "kme-alice", None),
            (relay, "kme-r2", None),  # not from who is before
            (relay, "sae-alice", None),
            (replace(relay, master="b"), "kme-alice", None),  # not of the host that it begins at
            (replace(relay, slaves=("r",)), "kme-alice", None),
            (
                replace(relay, hops=long_ago.hops, issued_ns=long_ago.issued_ns),
                "kme-alice",
                "older than 10 s",
            ),
        ):
            with pytest.raises(Refused, match=words) as refused:
                await row.of["r1"].accept_relay(manager, encode_sealed(changed.encode(), tag))
            assert refused.value.status == (400 if words else 401)
        with pytest.raises(MalformedPacket):
            await row.of["r1"].accept_relay("kme-alice", b"{}")

    play(tmp_path, scene)


def test_keys_that_a_hop_has_not_taken_are_thrown_away_at_both_ends(tmp_path: Path) -> None:
    async def scene(row: Row) -> None:
        def lost(_body: bytes) -> bytes:
            raise unavailable("nobody answers")

        row.change = lost
        with pytest.raises(Refused, match="nobody answers"):
            await row.of["alice"].get_keys("a", "b", KeyRequest())
        assert row.left("alice", "r1") == (STORED - 2, STORED)
        row.change = bytes
        await row.of["alice"].get_keys("a", "b", KeyRequest())
        assert row.left("alice", "r1") == (STORED - 4, STORED - 4)

    play(tmp_path, scene)
