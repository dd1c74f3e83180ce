"""Key relays: hears what key managers have, and chooses by whom keys of others are relayed.

Key managers speak as node agents do (applications.keys.route_messages), and their datagrams take
the same way: up from the classical switch of their host, and back by it. All state belongs to this
app's thread.
"""

import time
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any

from applications.keys.key_network import KeyNetwork, NoRoute, Stores, stores_of
from applications.keys.key_view import PPM, keys_view
from applications.keys.route_messages import (
    FROM_KEY_MANAGER,
    KEY_AGENT_PORT,
    TO_KEY_MANAGER,
    UNKNOWN,
    Hop,
    KeyLinks,
    KeyRoute,
    KeyRouteRequest,
    route_tag,
)
from controller_apps.apps.ticks import Ticks
from controller_apps.console.questions import EventQuestion, Refused, reply
from controller_apps.devices.hosts_state import Place
from controller_apps.light.optics import SwitchPort
from controller_apps.openflow import flow_entries
from controller_apps.openflow.framework import (
    DEAD,
    MAIN,
    App,
    Datapath,
    hub,
    ofp_event,
    ofproto,
    on,
)
from controller_apps.packets import CONTROLLER_MAC, Frame
from controller_apps.policy.reading import BadPolicy, read_policy
from controller_apps.record import PortLines, Record
from controller_apps.timeouts import DEVICE_TICK_S
from wire.config import ControllerConfig
from wire.device import DEVICE_PORT, Datagram, host_of, open_sealed
from wire.malformed import MalformedPacket
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason
from wire.network_time import SteppedTime


@dataclass(frozen=True)
class Heard:
    host: str
    place: Place
    message: Message


class KeyRelays(App):
    OFP_VERSIONS = (ofproto.OFP_VERSION,)

    def __init__(self, config: ControllerConfig, record: Record, **contexts: Any) -> None:
        super().__init__(**contexts)
        self.quantum_switches = frozenset(config.quantum_switches.values())
        self.address, self.policy_path = config.address, config.policy
        self.time, self._ticks = config.time, Ticks(config.time, DEVICE_TICK_S)
        self.keys, self.addresses = config.device_keys, config.addresses
        self.record = record
        self.datapaths: dict[int, Datapath] = {}
        names = {address: host for host, address in config.addresses.items()}
        self.network = KeyNetwork(names, read_policy(config.policy))
        self._numbers: dict[str, int] = {}  # of the last datagram that was taken, by host
        self._number = 0
        self._port_lines = PortLines(self.logger)

    def start(self) -> Any:
        """Begin to handle events; called by the framework."""
        super().start()
        if isinstance(self.time, SteppedTime):
            hub.spawn(self._tick_for_ever)

    def _tick_for_ever(self) -> None:
        while True:
            self._ticks.wait()

    @on(ofp_event.EventOFPStateChange, MAIN, DEAD)
    def switch_changed(self, event: Any) -> None:
        datapath = event.datapath
        dpid = datapath.id
        if event.state == MAIN:
            self.datapaths[dpid] = datapath
        elif self.datapaths.get(dpid) is datapath:
            del self.datapaths[dpid]

    def takes(self, message: Any) -> bool:
        return flow_entries.is_picked_datagram(message, self.quantum_switches)

    @on(ofp_event.EventOFPPacketIn, MAIN)
    def packet_arrived(self, event: Any) -> None:
        """Take in the datagrams of key managers; the rest is not ours."""
        message, frame = event.msg, bytes(event.msg.data)
        if not self.takes(message):
            return
        self._port_lines.time_passed(self._ticks.now_s())
        try:
            datagram = Frame.decode(frame)
            if datagram.source_port != KEY_AGENT_PORT:
                return  # of a node agent
            heard = self._open(message, datagram)
        except MalformedPacket as error:
            self._dropped(message, str(error))
            return
        if isinstance(heard.message, KeyLinks | KeyRouteRequest):
            self._take_in(heard)
        else:
            self._dropped(message, f"{type(heard.message).__name__} of a key manager")

    def _dropped(self, message: Any, what: str) -> None:
        at = SwitchPort(message.datapath.id, message.match["in_port"])
        self._port_lines.add(at, f"dropped: {what}", self._ticks.now_s())

    def _open(self, message: Any, frame: Frame) -> Heard:
        host = host_of(frame.payload)
        if host not in self.keys or host not in self.addresses:
            raise MalformedPacket(f"no device key for {host!r}")
        datagram = open_sealed(frame.payload, self.keys[host], FROM_KEY_MANAGER)
        if datagram.number <= self._numbers.get(host, 0):
            raise MalformedPacket(f"{host}: number {datagram.number} was used before")
        self._numbers[host] = datagram.number
        in_port = message.match["in_port"]
        place = Place(message.datapath.id, in_port, frame.source_mac, frame.source)
        return Heard(host, place, datagram.message)

    def _take_in(self, heard: Heard) -> None:
        address, now = self.addresses[heard.host], self._ticks.now_s()
        match heard.message:
            case KeyLinks(_, links):
                before = self.network.stores(address)
                self.network.take(address, links, now)
                self._note_fill(address, before, now)
            case KeyRouteRequest() as request:
                self._send(heard, self._answer(heard, address, request, now))

    def _note_fill(self, address: str, before: dict[str, Stores], now: float) -> None:
        """Record the links of a host whose stores have another fill than before."""
        for link, usable in self.network.links_of(address, now):
            if before.get(link.peer) == stores_of(link):
                continue
            self.record.write(
                "key_link",
                from_=self.network.names[address],
                to=self.network.names[link.peer],
                keys_ready=link.mine,
                keys_ready_there=link.theirs,
                max_key_count=link.capacity,
                key_bits_per_s=link.rate_bps,
                qber=None if link.qber_ppm == UNKNOWN else link.qber_ppm / PPM,
                state="active" if usable else "off",
            )

    def _answer(self, heard: Heard, address: str, request: KeyRouteRequest, now: float) -> Message:
        host = heard.host
        master, slave, stored = request.master, request.slave, request.stored
        write = partial(
            self.record.write, "key-route", host=host, master=master, slave=slave, stored=stored
        )
        try:
            nodes, stored = self.network.serve(address, request, now)
        except NoRoute as error:
            self._port_lines.add(heard.place.at, f"no route of keys for {host}: {error}", now)
            write(text=str(error))
            return Answer(request.session, Reason.NOT_ALLOWED, str(error))
        route = [self.network.names[node] for node in nodes]
        write(route=route)
        issued_ns = self.time.stamp_ns()
        first, *others = nodes
        tags = [route_tag(self.keys[self.network.names[node]], issued_ns, nodes) for node in others]
        hops = [Hop(first), *(Hop(*hop) for hop in zip(others, tags, strict=True))]
        return KeyRoute(request.session, issued_ns, stored, tuple(hops))

    def _send(self, heard: Heard, message: Message) -> None:
        place = heard.place
        datapath = self.datapaths.get(place.dpid)
        if datapath is None:
            return  # its switch is gone
        self._number = max(self._number + 1, time.time_ns())
        datagram = Datagram(message, heard.host, self._number)
        frame = Frame(
            source_mac=CONTROLLER_MAC,
            destination_mac=place.mac,
            source=self.address,
            destination=place.address,
            source_port=DEVICE_PORT,
            destination_port=KEY_AGENT_PORT,
            payload=datagram.seal(self.keys[heard.host], TO_KEY_MANAGER),
        )
        out = flow_entries.packet_out(datapath, ofproto.OFPP_CONTROLLER, place.port, frame.encode())
        datapath.send_msg(out)

    def close(self) -> None:
        self._port_lines.time_passed(inf)

    @on(EventQuestion)
    def asked(self, question: Any) -> None:
        handlers = {
            "keys": lambda: {"qkd_nodes": keys_view(self.network, self._ticks.now_s())},
            "reload": self._reload_policy,
        }
        reply(question, handlers)

    def _reload_policy(self) -> str:
        try:
            self.network.policy = read_policy(self.policy_path)
        except BadPolicy as error:
            raise Refused(f"{error}; the policy before stays in force") from error
        return self.policy_path
