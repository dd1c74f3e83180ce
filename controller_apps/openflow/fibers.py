"""The fibres of all quantum switches: who is at their ends, whole or cut, how tuned.

Turns what switches say of their ports, and LLDP, into the network; the app that owns it
calls it from its own thread.
"""

import secrets
from collections import defaultdict
from logging import Logger
from typing import Any

from controller_apps.light.links import Links
from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import Network
from controller_apps.openflow import discovery, flow_entries, optical_messages
from controller_apps.openflow.framework import Datapath, ofproto
from controller_apps.openflow.identities import Identities
from controller_apps.record import Record
from wire.malformed import MalformedPacket
from wire.optical import EXPERIMENTER, PATH_OPTICS, PathOptics, decode_path_optics


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
        self._told: defaultdict[int, list[PathOptics]] = defaultdict(list)  # parts of an answer

    def switch_here(self, datapath: Datapath, now: float) -> None:
        """Take in the ports of a switch, and ask for its optics; see `told` and `silent`."""
        self._datapaths[datapath.id] = datapath
        for port in list(datapath.ports.values()):
            self._port_is(datapath, port, optical_messages.is_up(port), now)
        self._ask(datapath)

    def switch_left(self, dpid: int) -> None:
        self._datapaths.pop(dpid, None)
        self._asked.pop(dpid, None)
        self._told.pop(dpid, None)
        self._links.switch_left(dpid)
        self.network.optics.forget_switch(dpid)

    def _port_is(self, datapath: Datapath, port: Any, whole: bool, now: float) -> bool:
        at = SwitchPort(datapath.id, port.port_no)
        if port.port_no > ofproto.OFPP_MAX:
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
        self._told.pop(datapath.id, None)
        datapath.send_msg(optical_messages.ask_ports(datapath))

    def learn(self, message: Any) -> bool:
        """Take a part of the answer about optics; tell whether it is whole now."""
        dpid, body = message.datapath.id, message.body
        kind = body.experimenter, body.exp_type
        if kind != (EXPERIMENTER, PATH_OPTICS) or message.xid != self._asked.get(dpid):
            return False
        try:
            self._told[dpid] += decode_path_optics(bytes(body.data))
        except MalformedPacket as error:
            self._logger.warning("switch %#x: %s", dpid, error)
            return False
        if message.flags & ofproto.OFPMPF_REPLY_MORE:
            return False
        self.network.optics.told(dpid, SwitchOptics.reported(self._told.pop(dpid)))
        return True

    def silent(self, dpid: int, xid: int) -> bool:
        """Tell whether an error is the answer of a switch that cannot tell its optics."""
        if xid != self._asked.get(dpid):
            return False
        self.network.optics.told(dpid, SwitchOptics())
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
