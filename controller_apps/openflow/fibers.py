"""The fibres of all quantum switches: who is at their ends, whole or cut, how tuned.

Turns what switches say of their ports, and LLDP, into the network; the app that owns it
calls it from its own thread.

Fibres between switches, as heard from both their ends.

    port up --> speaks, and again until it hears somebody, then every LINK_PERIOD_S
    hears who has not heard it --> answers at once
    heard at both ends --> a link --port down, switch gone, not heard for long--> none

Where a host is, nobody hears a port; a fibre that is laid elsewhere is cut first, and the port
speaks again when it is whole.

No socket, no clock: `now` is in seconds of one steady clock.
"""

import secrets
from collections import defaultdict
from dataclasses import dataclass, field
from logging import Logger
from math import inf
from typing import Any

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import Network
from controller_apps.openflow import discovery, flow_entries, optical_messages
from controller_apps.openflow.discovery import Identities
from controller_apps.openflow.framework import Datapath, ofproto
from controller_apps.record import Record
from controller_apps.timeouts import LINK_EXPIRY_S, LINK_FAST_PERIOD_S, LINK_PERIOD_S
from wire.malformed import MalformedPacket
from wire.optical import EXPERIMENTER, PATH_OPTICS, PathOptics, decode_path_optics

FAST_TIMES = 10  # while the network starts (802.1AB fast start)
ANNOUNCEMENTS_PER_S = 25  # at most, of all ports that have been heard: each less often then
LEAST_AT_ONCE = 4  # of these that are due


@dataclass
class _Port:
    due: float
    sent: int = 0
    spoke_s: float = -inf

    def speak(self, now: float, pause_s: float) -> None:
        self.sent += 1
        self.spoke_s, self.due = now, now + pause_s


@dataclass(frozen=True)
class _Heard:
    """The last message at a port, and the interval of messages then: so long it may be silent."""

    speaker: SwitchPort
    when_s: float
    slower: float


@dataclass
class Links:
    """When each fibre port speaks next, and what was last heard where."""

    network: Network
    _ports: dict[SwitchPort, _Port] = field(default_factory=dict)
    _heard: dict[SwitchPort, _Heard] = field(default_factory=dict)
    _last_s: float = 0.0  # when it was asked who shall speak
    _slower: float = 1.0  # how many times longer a large network waits than a small one

    def port_up(self, at: SwitchPort, now: float) -> None:
        self._ports[at] = _Port(now)

    def port_down(self, at: SwitchPort) -> None:
        self._ports.pop(at, None)
        self._heard.pop(at, None)
        self.network.remove_link(at)

    def switch_left(self, dpid: int) -> None:
        ends = {at for at in (*self._ports, *self._heard, *self.network.links) if at.dpid == dpid}
        for at in ends:
            self.port_down(at)

    def _measure(self) -> None:
        """Note how large the network is: of the ports that speak, those of hosts do not."""
        speaking = sum(at not in self.network.hosts for at in self._ports)
        self._slower = max(1.0, speaking / (LINK_PERIOD_S * ANNOUNCEMENTS_PER_S))

    def due(self, now: float) -> list[SwitchPort]:
        """Return the ports that shall speak now; never all of a large network at once."""
        self._measure()
        period_s, spoken, waiting = LINK_PERIOD_S * self._slower, [], []
        for at, port in self._ports.items():
            if at in self.network.hosts:
                continue
            if port.due <= now and self._is_new(at, port):
                port.speak(now, LINK_FAST_PERIOD_S if port.sent + 1 < FAST_TIMES else period_s)
                spoken.append(at)
            elif port.due <= now:
                waiting.append((port.due, at))
        waiting.sort()
        at_once = LEAST_AT_ONCE + int(ANNOUNCEMENTS_PER_S * (now - self._last_s))
        for _due, at in waiting[:at_once]:
            self._ports[at].speak(now, period_s)
            spoken.append(at)
        self._last_s = now
        return spoken

    def _is_new(self, at: SwitchPort, port: _Port) -> bool:
        """Whether nobody was heard at a port that has not spoken often either."""
        return at not in self._heard and port.sent < FAST_TIMES

    def answers(self, at: SwitchPort, speaker: SwitchPort, now: float) -> bool:
        """Tell whether a port that has heard another shall speak now: to who has not heard it.

        Its message of a moment ago is on its way.
        """
        port, heard = self._ports.get(at), self._heard.get(speaker)
        if port is None or (heard is not None and heard.speaker == at):
            return False
        if now - port.spoke_s < LINK_FAST_PERIOD_S:
            return False
        port.speak(now, LINK_PERIOD_S * self._slower)
        return True

    def heard(self, speaker: SwitchPort, at: SwitchPort, now: float) -> bool:
        """Take what a port was heard to say at another; tell whether that is a new link."""
        if speaker not in self._ports or at not in self._ports:
            return False  # a message that was long on its way
        self._heard[at] = _Heard(speaker, now, self._slower)
        there = self._heard.get(speaker)
        return there is not None and there.speaker == at and self.network.add_link(speaker, at)

    def expired(self, now: float) -> list[SwitchPort]:
        """Forget the links that were not heard for long at one end; return these ends."""
        self._measure()
        silent = [at for at, heard in self._heard.items() if self._is_silent(heard, now)]
        for at in silent:
            del self._heard[at]
        return [at for at in silent if self.network.remove_link(at) is not None]

    def _is_silent(self, heard: _Heard, now: float) -> bool:
        """Whether a port has heard nothing for too long, by how seldom ports spoke or speak."""
        return now - heard.when_s > LINK_EXPIRY_S * max(heard.slower, self._slower)


class Fibers:
    """Fibres and optics of the switches that are connected."""

    def __init__(
        self, network: Network, record: Record, logger: Logger, identities: Identities
    ) -> None:
        self.network = network
        self._identities = identities
        self.needs_seal = True  # of a host, on what it announces
        self._links = Links(network)
        self._record, self._logger = record, logger
        self._key = secrets.token_bytes(32)  # of the seals on our LLDP
        self._datapaths: dict[int, Datapath] = {}
        self._asked: dict[int, int] = {}  # by datapath id, the last question for optics
        self._reports: defaultdict[int, list[PathOptics]] = defaultdict(list)  # parts of an answer

    def switch_here(self, datapath: Datapath, now: float) -> None:
        """Take in the ports of a switch, and ask for its optics; see `reported` and `silent`."""
        self._datapaths[datapath.id] = datapath
        for port in list(datapath.ports.values()):
            self._port_is(datapath, port, optical_messages.is_up(port), now)
        self._ask(datapath)

    def switch_left(self, dpid: int) -> None:
        self._datapaths.pop(dpid, None)
        self._asked.pop(dpid, None)
        self._reports.pop(dpid, None)
        self._links.switch_left(dpid)
        self.network.optics.forget_switch(dpid)
        for port in self.network.inner.pop(dpid, frozenset()):
            self.network.modes.pop(SwitchPort(dpid, port), None)

    def _port_is(self, datapath: Datapath, port: Any, whole: bool, now: float) -> bool:
        at = SwitchPort(datapath.id, port.port_no)
        if port.port_no > ofproto.OFPP_MAX:
            return False
        if optical_messages.is_inner(port):
            others = self.network.inner.get(at.dpid, frozenset()) - {at.port}
            self.network.inner[at.dpid] = others | ({at.port} if whole else frozenset())
            if (modes := optical_messages.modes_of(port)) is not None:
                self.network.modes[at] = modes
            return False
        optics = optical_messages.port_optics(port)
        if optics is not None:
            self.network.optics.described(at, optics)
        news = self.network.set_fiber(at, whole)
        if news:
            self._logger.info("port %#x:%d is %s", *at, "up" if whole else "down")
            self._record.write("port", dpid=at.dpid, at=at.port, up=whole)
        if not whole:
            self._links.port_down(at)
        elif self._is_fiber(datapath, port):
            self._links.port_up(at, now)
        return news

    def port_changed(self, message: Any, now: float) -> bool:
        """Take in a change of a port; tell whether its fibre was cut or mended."""
        datapath, port = message.datapath, message.desc
        whole = message.reason != ofproto.OFPPR_DELETE and optical_messages.is_up(port)
        news = self._port_is(datapath, port, whole, now)
        self._ask(datapath)
        return news

    def _is_fiber(self, datapath: Datapath, port: Any) -> bool:
        """Tell whether a port is optical; where no port says so, any may be."""
        is_fiber = optical_messages.is_fiber
        return is_fiber(port) or not any(map(is_fiber, list(datapath.ports.values())))

    def _ask(self, datapath: Datapath) -> None:
        question = optical_messages.ask_paths(datapath)
        datapath.send_msg(question)
        self._asked[datapath.id] = question.xid
        self._reports.pop(datapath.id, None)
        datapath.send_msg(optical_messages.ask_ports(datapath))

    def learn(self, message: Any) -> bool:
        """Take a part of the answer about optics; tell whether it is whole now."""
        dpid, body = message.datapath.id, message.body
        kind = body.experimenter, body.exp_type
        if kind != (EXPERIMENTER, PATH_OPTICS) or message.xid != self._asked.get(dpid):
            return False
        try:
            self._reports[dpid] += decode_path_optics(bytes(body.data))
        except MalformedPacket as error:
            self._logger.warning("switch %#x: %s", dpid, error)
            return False
        if message.flags & ofproto.OFPMPF_REPLY_MORE:
            return False
        self.network.optics.take(dpid, SwitchOptics.reported(self._reports.pop(dpid)))
        return True

    def silent(self, dpid: int, xid: int) -> bool:
        """Tell whether an error is the answer of a switch that cannot tell its optics."""
        if xid != self._asked.get(dpid):
            return False
        self.network.optics.take(dpid, SwitchOptics())
        return True

    def measured(self, message: Any) -> None:
        """Take the statistics of ports, which the device monitor asks for all the time."""
        for statistics in message.body:
            light = optical_messages.port_light(statistics)
            if light is not None:
                at = SwitchPort(message.datapath.id, statistics.port_no)
                if self.network.optics.measured(at, light):
                    self._record.write("tuned", dpid=at.dpid, at=at.port, mhz=light.tx_mhz)

    def spoke(self, at: SwitchPort, frame: bytes, now: float) -> bool:
        """Take LLDP that came in at a port; tell whether a fibre between switches is new.

        Raise MalformedPacket for what is not to be understood or not to be believed.
        """
        message = discovery.parse(frame)
        if isinstance(message, discovery.Announcement):
            self._host_spoke(at, message)
            return False
        if not message.seal:
            return False  # of another controller
        if not discovery.is_genuine(message, self._key):
            raise MalformedPacket(f"LLDP in the name of {message.at.dpid:#x}:{message.at.port}")
        news = self._links.heard(message.at, at, now)
        if news:
            self._link("link", message.at, at)
        if self._links.answers(at, message.at, now):
            self._speak(at)
        return news

    def _host_spoke(self, at: SwitchPort, announcement: discovery.Announcement) -> None:
        if self.needs_seal:
            self._identities.check(announcement)
        network, port = self.network, announcement.host_port
        news = network.detach(at) if announcement.leaving else network.attach(at, port)
        if news:
            verb = "leaves" if announcement.leaving else "is at"
            self._logger.info("%s (%s) %s %#x:%d", port.name, port.address, verb, *at)
            self._record.write("fiber", host=port.host, port=port.name, dpid=at.dpid, at=at.port)

    def _link(self, event: str, one: SwitchPort, other: SwitchPort) -> None:
        self._logger.info("%s between %#x:%d and %#x:%d", event, *one, *other)
        self._record.write(event, ends=sorted([one, other]))

    def time_passed(self, now: float) -> None:
        for at in self._links.expired(now):
            self._logger.info("nothing heard at %#x:%d any more", *at)
        for at in self._links.due(now):
            self._speak(at)

    def _speak(self, at: SwitchPort) -> None:
        datapath = self._datapaths[at.dpid]
        port = datapath.ports.get(at.port)
        if port is None:
            return  # it is being removed
        address = bytes.fromhex(port.hw_addr.replace(":", ""))
        frame = discovery.switch_message(at, address, self._key)
        out = flow_entries.packet_out(datapath, ofproto.OFPP_CONTROLLER, at.port, frame)
        datapath.send_msg(out)
