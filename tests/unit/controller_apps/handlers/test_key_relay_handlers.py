"""The app of key relays on one framework: what key managers say, and what they are answered."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from handlers_scene import Datapath
from metadata_scene import Q1, S1
from scapy.layers.inet import IP, UDP
from scapy.layers.l2 import Ether

from applications.keys.key_relays import KeyRelays
from applications.keys.route_messages import (
    FROM_KEY_MANAGER,
    KEY_AGENT_PORT,
    TO_KEY_MANAGER,
    KeyLinks,
    KeyRoute,
    KeyRouteRequest,
    LinkState,
    route_tag,
)
from controller_apps.console.questions import EventQuestion
from controller_apps.openflow import framework
from controller_apps.openflow.framework import ofp_event, parser
from controller_apps.record import Record
from wire.config import ControllerConfig
from wire.device import DEVICE_PORT, Datagram, DeviceQuery, open_sealed
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason

KEYS = {"alice": "aa" * 16, "bob": "bb" * 16, "r": "cc" * 16}
ADDRESSES = {"alice": "10.0.0.1", "bob": "10.0.0.2", "r": "10.0.0.9"}
CONTROLLER = "10.0.0.254"
ASKED = KeyRouteRequest(7, ADDRESSES["bob"], 2, "sae-alice", "sae-bob")


class Scene:
    """The app, a classical and a quantum switch."""

    def __init__(self, folder: Path) -> None:
        self.policy = folder / "policy.toml"
        self.policy.write_text('[[trusted]]\nhost = "r"\n')
        self.record = folder / "record.jsonl"
        config = ControllerConfig(
            "127.0.0.1:1",
            framework.NAME,
            {"q1": Q1},
            address=CONTROLLER,
            device_keys=KEYS,
            addresses=ADDRESSES,
            policy=str(self.policy),
        )
        self.app = KeyRelays(config, Record(str(self.record)))
        self.s1, self.q1 = Datapath(S1), Datapath(Q1)
        self.number = 0
        for datapath in (self.s1, self.q1):
            self.app.switch_changed(SimpleNamespace(datapath=datapath, state=framework.MAIN))

    def says(
        self, message: Message, host: str = "alice", key: str = "", port: int = KEY_AGENT_PORT
    ) -> list[Message]:
        """Let a key manager say something; return the packets that s1 has to send it."""
        self.number += 1
        sealed = Datagram(message, host, self.number).seal(key or KEYS[host], FROM_KEY_MANAGER)
        return self.hears(sealed, host, port)

    def hears(
        self, sealed: bytes, host: str = "alice", port: int = KEY_AGENT_PORT
    ) -> list[Message]:
        frame = (
            Ether(src="02:00:00:00:00:01", dst="ff:ff:ff:ff:ff:ff")
            / IP(src=ADDRESSES[host], dst="10.0.0.255")
            / UDP(sport=port, dport=DEVICE_PORT)
            / sealed
        )
        match = parser.OFPMatch(in_port=3)
        message = parser.OFPPacketIn(self.s1, table_id=1, match=match, data=bytes(frame))
        self.app.packet_arrived(ofp_event.EventOFPPacketIn(message))
        return [self.read(sent, host) for sent in self.s1.take()]

    def read(self, sent: object, host: str) -> Message:
        packet = Ether(sent.frame)  # type: ignore[attr-defined]
        assert (packet[IP].src, packet[IP].dst) == (CONTROLLER, ADDRESSES[host])
        assert (packet[UDP].sport, packet[UDP].dport) == (DEVICE_PORT, KEY_AGENT_PORT)
        return open_sealed(bytes(packet[UDP].payload), KEYS[host], TO_KEY_MANAGER).message

    def link(self, one: str, other: str) -> None:
        """Let a host say that it has 9 keys with another."""
        assert self.says(KeyLinks(0, (LinkState(ADDRESSES[other], 9, 9, 64, 100, 0),)), one) == []


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    made = Scene(tmp_path)
    made.link("alice", "r")
    made.link("r", "bob")
    return made


def test_a_route_has_a_tag_for_each_host_that_is_to_relay(scene: Scene) -> None:
    (route,) = scene.says(ASKED)
    assert isinstance(route, KeyRoute)
    nodes = tuple(ADDRESSES[host] for host in ("alice", "r", "bob"))
    assert (route.session, route.nodes, route.stored) == (7, nodes, 9)
    for hop, host in zip(route.hops[1:], ("r", "bob"), strict=True):
        assert hop.tag == route_tag(KEYS[host], route.issued_ns, nodes)
    fact = json.loads(scene.record.read_text().splitlines()[-1])
    assert (fact["event"], fact["route"]) == ("key-route", ["alice", "r", "bob"])


def test_without_trust_the_answer_says_who_could(scene: Scene) -> None:
    scene.policy.write_text("")
    question = EventQuestion("reload", {})
    scene.app.asked(question)
    assert question.wait() == str(scene.policy)
    (answer,) = scene.says(ASKED)
    assert isinstance(answer, Answer)
    assert (answer.session, answer.reason) == (7, Reason.NOT_ALLOWED)
    assert "r could, if [[trusted]]" in answer.text


def test_what_is_not_from_a_key_manager_of_the_network_changes_nothing(scene: Scene) -> None:
    before = dict(scene.app.network.hosts)
    links = KeyLinks(0, ())
    assert scene.says(links, key="dd" * 16) == []  # forged
    assert scene.says(links, port=DEVICE_PORT) == []  # of a node agent
    assert scene.says(DeviceQuery(1)) == []
    old = Datagram(links, "alice", 1).seal(KEYS["alice"], FROM_KEY_MANAGER)
    assert scene.hears(old) == []  # heard before
    host = Datagram(links, "alice", 99).seal(KEYS["alice"], Datagram.FROM_HOST)
    assert scene.hears(host) == []  # of another speaker
    assert scene.app.network.hosts == before
    for data in (b"", b"x" * 100):
        assert scene.hears(data) == []
    stranger = Datagram(links, "mallory", 100).seal("aa" * 16, FROM_KEY_MANAGER)
    assert scene.hears(stranger) == []


def test_the_last_datagram_of_a_key_manager_is_answered_once(scene: Scene) -> None:
    """The same bytes again: neither for the host that sent them last, nor after another's."""
    sealed = Datagram(ASKED, "alice", 50).seal(KEYS["alice"], FROM_KEY_MANAGER)
    (route,) = scene.hears(sealed)
    assert isinstance(route, KeyRoute)
    assert scene.hears(sealed) == []
    scene.link("bob", "r")
    assert scene.hears(sealed) == []


def test_the_fill_of_key_stores_is_recorded_when_it_changes(tmp_path: Path) -> None:
    scene = Scene(tmp_path)

    def recorded() -> list[dict[str, object]]:
        lines = scene.record.read_text().splitlines()
        facts = [json.loads(line) for line in lines]
        return [fact for fact in facts if fact["event"] == "key_link"]

    scene.says(KeyLinks(0, (LinkState(ADDRESSES["bob"], 0, 0, 64, 0),)))
    scene.says(KeyLinks(0, (LinkState(ADDRESSES["bob"], 12, 11, 64, 4096, 12_300),)))
    scene.says(KeyLinks(0, (LinkState(ADDRESSES["bob"], 12, 11, 64, 3000, 12_300),)))  # as full
    scene.says(KeyLinks(0, (LinkState(ADDRESSES["bob"], 12, 11, 64, 0, 12_300, True),)))
    own = ("keys_ready", "keys_ready_there", "max_key_count", "key_bits_per_s", "qber", "state")
    names = ("from_", "to", *own)
    assert [tuple(fact[name] for name in names) for fact in recorded()] == [
        ("alice", "bob", 0, 0, 64, 0, None, "active"),
        ("alice", "bob", 12, 11, 64, 4096, 0.0123, "active"),
        ("alice", "bob", 12, 11, 64, 0, 0.0123, "off"),
    ]
