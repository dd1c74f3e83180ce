"""Device monitor: polls every device, takes in what they report by themselves, sets hosts.

Quantum switches answer by OpenFlow (port descriptions, port and flow statistics) and report
by PORT_STATUS. Hosts answer by datagrams of wire.device, which reach the controller like
this, although it has no address in the hosts' network:

    host --UDP to DEVICE_PORT--> s1, whose entry sends it up and nowhere else (PACKET_IN)
    host <--UDP from the controller's address-- s1, which sends it out (PACKET_OUT)

The entry also keeps hosts from sending such datagrams to each other; what gets past it, as
a fragment may, lacks the HMAC. All state belongs to this app's own thread.
"""

import time
from dataclasses import dataclass, fields, replace
from logging import WARNING
from math import ceil, inf
from typing import Any

from controller_apps.apps.host_commands import (
    EventAlarm,
    EventCommand,
    EventEstimate,
    EventMonitorOver,
    EventNodeAnswered,
    EventSessionReported,
    HostCommands,
    session_of,
)
from controller_apps.apps.ticks import Ticks
from controller_apps.console.questions import EventQuestion, Refused, reply
from controller_apps.devices.hosts_state import Hosts, Place, Report, host_view, switch_view
from controller_apps.devices.switch_state import SwitchState
from controller_apps.light.optics import SwitchPort
from controller_apps.openflow import flow_entries
from controller_apps.openflow.framework import (
    DEAD,
    MAIN,
    App,
    Datapath,
    Event,
    hub,
    ofp_event,
    ofproto,
    on,
    parser,
)
from controller_apps.packets import CONTROLLER_MAC, Frame
from controller_apps.policy.policy import Policy
from controller_apps.policy.reading import BadPolicy, read_policy
from controller_apps.record import PortLines, Record
from controller_apps.sessions.actions import HostCommand
from controller_apps.timeouts import DEVICE_TICK_S, SET_TIMEOUT_S
from wire.config import ControllerConfig
from wire.device import (
    DEVICE_PORT,
    PERIODS_S,
    DeviceQuery,
    DeviceSettings,
    SessionQuery,
    check_settings,
)
from wire.malformed import MalformedPacket
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import PreemptMonitor
from wire.parameters.checks import remedy

POLLS_PER_S = 100  # at most, of all devices: what they do meanwhile they report by themselves
LEAST_AT_ONCE = 4  # that are due
METADATA = "QuantumMetadata"  # the app that asks for orders


class EventDeviceTick(Event):
    """Time has passed."""


@dataclass
class Waiting:
    """A question about a host that its own answer will settle."""

    question: EventQuestion
    host: str
    until: float


class DeviceMonitor(App):
    OFP_VERSIONS = (ofproto.OFP_VERSION,)

    def __init__(self, config: ControllerConfig, record: Record, **contexts: Any) -> None:
        super().__init__(**contexts)
        self.quantum_switches = frozenset(config.quantum_switches.values())
        self.address, self.time = config.address, config.time
        self._ticks = Ticks(config.time, DEVICE_TICK_S)
        self.policy_path = config.policy
        self.record = record
        self.datapaths: dict[int, Datapath] = {}
        self.switches: dict[int, SwitchState] = {}
        self.hosts = Hosts(config.device_keys)
        self._take_policy(read_policy(config.policy))
        self._number = 0
        self._polled: dict[int | str, float] = {}  # when each device was last
        self._waiting: list[Waiting] = []
        self._commands = HostCommands()
        self._silent: set[str] = set()
        self._port_lines = PortLines(self.logger)

    def start(self) -> Any:
        """Begin to handle events; called by the framework."""
        super().start()
        hub.spawn(self._tick_for_ever)

    def _tick_for_ever(self) -> None:
        while True:
            self._ticks.wait()
            self.send_event(self.name, EventDeviceTick())

    def close(self) -> None:
        """Say what lines were left out."""
        self._port_lines.time_passed(inf)

    @on(EventDeviceTick)
    def time_passed(self, event: Any) -> None:
        now = self._ticks.now_s()
        self._port_lines.time_passed(now)
        self._give_up_waiting(now)
        self._repeat_commands(self._now())
        for device in self._due(now):
            self._polled[device] = now
            if isinstance(device, int):
                self._poll_switch(self.datapaths[device])
                continue
            self._send(device, DeviceQuery(self._next_number()))
            self._note_silence(device, now)

    def _due(self, now: float) -> list[int | str]:
        """Return whom to poll now: switches and hosts, never all of a large network at once."""
        period_s = self.hosts.reporting.period_s
        switches = [dpid for dpid in self.switches if dpid in self.datapaths]
        devices: list[int | str] = [*switches, *self.hosts.states]
        polled = {device: self._polled.get(device, -inf) for device in devices}
        due = [device for device in devices if now - polled[device] >= period_s]
        due.sort(key=polled.__getitem__)
        return due[: LEAST_AT_ONCE + ceil(len(devices) * DEVICE_TICK_S / period_s)]

    def _now(self) -> float:
        """Return the time of the network, by which orders go; reports and polls go by the wall."""
        return self.time.now_s()

    def _poll_switch(self, datapath: Datapath) -> None:
        port, group, match = ofproto.OFPP_ANY, ofproto.OFPG_ANY, parser.OFPMatch()
        for request in (
            parser.OFPPortDescStatsRequest(datapath, 0),
            parser.OFPPortStatsRequest(datapath, 0, port),
            parser.OFPFlowStatsRequest(datapath, 0, 0, port, group, 0, 0, match),
        ):
            datapath.send_msg(request)

    @on(ofp_event.EventOFPStateChange, MAIN, DEAD)
    def switch_changed(self, event: Any) -> None:
        datapath, now = event.datapath, self._ticks.now_s()
        dpid = datapath.id
        if event.state == MAIN:
            self.datapaths[dpid] = datapath
            if dpid in self.quantum_switches:
                self.switches[dpid] = SwitchState(dpid, now)
                for port in datapath.ports.values():
                    self.switches[dpid].describe_port(port)
        elif self.datapaths.get(dpid) is datapath:
            del self.datapaths[dpid]
            if dpid in self.switches:
                self.switches[dpid].connected = False

    @on(ofp_event.EventOFPPortDescStatsReply, MAIN)
    def ports_described(self, event: Any) -> None:
        for port in self._heard(event.msg, event.msg.body):
            self._describe(event.msg.datapath.id, port)

    @on(ofp_event.EventOFPPortStatus, MAIN)
    def port_changed(self, event: Any) -> None:
        gone = event.msg.reason == ofproto.OFPPR_DELETE
        for port in self._heard(event.msg, [event.msg.desc]):
            self._describe(event.msg.datapath.id, port, gone)

    def _describe(self, dpid: int, port: Any, gone: bool = False) -> None:
        switch = self.switches[dpid]
        if switch.describe_port(port, gone):
            up = not gone and switch.ports[port.port_no]["up"]
            self.record.write("device", name=switch.name, port=port.port_no, up=up)

    @on(ofp_event.EventOFPPortStatsReply, MAIN)
    def ports_counted(self, event: Any) -> None:
        for statistics in self._heard(event.msg, event.msg.body):
            self.switches[event.msg.datapath.id].count_port(statistics)

    @on(ofp_event.EventOFPFlowStatsReply, MAIN)
    def flows_listed(self, event: Any) -> None:
        message = event.msg
        if message.datapath.id in self.switches:
            more = bool(message.flags & ofproto.OFPMPF_REPLY_MORE)
            entries = self._heard(message, message.body)
            self.switches[message.datapath.id].list_paths(entries, more)

    def _heard(self, message: Any, body: list[Any]) -> list[Any]:
        """Return what a message holds if it comes from a quantum switch, and note the time."""
        switch = self.switches.get(message.datapath.id)
        if switch is None:
            return []
        switch.heard = self._ticks.now_s()
        return body

    def takes(self, message: Any) -> bool:
        return flow_entries.is_picked_datagram(message, self.quantum_switches)

    @on(ofp_event.EventOFPPacketIn, MAIN)
    def packet_arrived(self, event: Any) -> None:
        """Take in the datagrams of hosts; the rest is not ours."""
        message, frame = event.msg, bytes(event.msg.data)
        if not self.takes(message):
            return
        try:
            datagram = Frame.decode(frame)
            if datagram.source_port != DEVICE_PORT:
                return  # of no node agent, but of a package's program
            place = Place(
                message.datapath.id,
                message.match["in_port"],
                datagram.source_mac,
                datagram.source,
            )
            report = self.hosts.heard(datagram.payload, place, self._ticks.now_s())
        except MalformedPacket as error:
            at = SwitchPort(message.datapath.id, message.match["in_port"])
            self._port_lines.add(at, f"dropped: {error}", self._ticks.now_s())
            return
        self._take_in(report)

    def _take_in(self, report: Report) -> None:
        host = report.host
        if report.first or host in self._silent:
            self._silent.discard(host)
            self.logger.info("%s connected", host)
            self.record.write("device", name=host, state="heard")
        state = self.hosts.states[host]
        if report.answer is not None and report.answer.reason != Reason.OK:
            text = f"{host}: {report.answer.text}"
            self._port_lines.add(state.place.at, text, self._ticks.now_s(), WARNING)
            self._settle(host, Refused(text))
        if report.estimate is not None:
            self.send_event(METADATA, EventEstimate(host, state.place.address, report.estimate))
            return
        if report.alarm:
            self.send_event(METADATA, EventAlarm(report.alarm, host, state.place))
        if report.monitor_ended:
            self.send_event(METADATA, EventMonitorOver(host, state.place.address, state.report))
        if report.answer is not None:
            self._order_answered(state.place.address, report.answer)
        if state.report.settings == self.hosts.wanted.get(host, DeviceSettings()):
            self._settle(host, host_view(host, state, silent=False, age_s=0.0))
        if report.answer is None:  # a report shows what is still to be set
            for message in self.hosts.due(host):
                self._send(host, message(self._next_number()))

    @on(EventCommand)
    def ordered(self, event: Any) -> None:
        """Tell or ask a host something about a session, until it has answered."""
        command = event.command
        self._commands.add(command.node, self._numbered(command.message), self._now())
        self._send_commands()

    def _numbered(self, message: HostCommand) -> HostCommand:
        return replace(message, session=self._next_number())

    def _order_answered(self, node: str, answer: Answer) -> None:
        command = self._commands.answered(node, answer.session)
        if command is None or isinstance(command, PreemptMonitor):
            return  # a link monitor may have ended before the command
        event = EventSessionReported if isinstance(command, SessionQuery) else EventNodeAnswered
        self.send_event(METADATA, event(session_of(command), node, Reason(answer.reason)))

    def _repeat_commands(self, now: float) -> None:
        for node, command in self._commands.give_up(now):
            session = session_of(command)
            self.logger.warning("%s has not answered its order for %016x", node, session)
        self._send_commands()

    def _send_commands(self) -> None:
        """Send what is not answered yet to those who have been heard; others may be, soon."""
        hosts = {state.place.address: host for host, state in self.hosts.states.items()}
        for node, command in self._commands.due():
            if node in hosts:
                self._send(hosts[node], command)

    @on(EventQuestion)
    def asked(self, question: Any) -> None:
        if question.name == "set":
            try:
                self._set(question, **question.fields)
            except Refused as refused:
                question.answer(refused)
            return
        reply(question, {"devices": self._devices, "reload": self._reload_policy})

    def _devices(self) -> list[dict[str, Any]]:
        now = self._ticks.now_s()
        period_s = self.hosts.reporting.period_s
        switches = [switch_view(switch, now, period_s) for switch in self.switches.values()]
        hosts = [
            host_view(host, state, self.hosts.silent(host, now), now - state.heard)
            for host, state in sorted(self.hosts.states.items())
        ]
        unheard = [
            {"name": host, "kind": "host", "state": "never heard"}
            for host in sorted(set(self.hosts.keys) - set(self.hosts.states))
        ]
        return [*switches, *hosts, *unheard]

    def _set(self, question: Any, device: str, settings: dict[str, Any]) -> None:
        """Override settings of a host; its own answer settles the question."""
        if device in {switch.name for switch in self.switches.values()}:
            raise Refused(f"{device} is a switch: its ports are tuned by OpenFlow (PORT_MOD)")
        if device not in self.hosts.keys:
            hosts = ", ".join(sorted(self.hosts.keys)) or "none"
            raise Refused(f"no device {device!r}; hosts with a node agent: {hosts}")
        if device not in self.hosts.states:
            raise Refused(f"{device} has sent no report yet; is its stack running?")
        known_names = [item.name for item in fields(DeviceSettings)]
        for name in settings:
            if name not in known_names:
                raise Refused(f"no setting {name!r}: {remedy(name, known_names)}")
        overrides = replace(self.hosts.wanted.get(device, DeviceSettings()), **settings)
        try:
            check_settings(overrides)
        except ValueError as error:
            raise Refused(str(error)) from error
        self.hosts.wanted[device] = overrides
        self.logger.info("%s shall use %s", device, overrides)
        self.record.write("override", name=device, **settings)
        self._waiting.append(Waiting(question, device, self._ticks.now_s() + SET_TIMEOUT_S))
        self._send(device, DeviceQuery(self._next_number()))  # its report shows what is due

    def _settle(self, host: str, answer: Any) -> None:
        for waiting in [waiting for waiting in self._waiting if waiting.host == host]:
            self._waiting.remove(waiting)
            waiting.question.answer(answer)

    def _give_up_waiting(self, now: float) -> None:
        for waiting in [waiting for waiting in self._waiting if waiting.until <= now]:
            self._waiting.remove(waiting)
            text = f"{waiting.host} has not answered in {SET_TIMEOUT_S:g} s; it is set once it does"
            waiting.question.answer(Refused(text))

    def _note_silence(self, host: str, now: float) -> None:
        if host not in self._silent and self.hosts.silent(host, now):
            self._silent.add(host)
            self.logger.warning("%s is silent", host)
            self.record.write("device", name=host, state="silent")

    def _reload_policy(self) -> str:
        try:
            self._take_policy(read_policy(self.policy_path))
        except BadPolicy as error:
            raise Refused(f"{error}; the policy before stays in force") from error
        return self.policy_path

    def _take_policy(self, policy: Policy) -> None:
        """Take overrides and reporting from the policy, in place of all there were."""
        for name in policy.devices:
            if name not in self.hosts.keys:
                hosts = ", ".join(sorted(self.hosts.keys)) or "none"
                raise BadPolicy(f"policy: device {name!r} is not a host; hosts are {hosts}")
        self.hosts.wanted = dict(policy.devices)
        devices = len(self.hosts.keys) + len(self.quantum_switches)
        period_s = max(policy.reporting.period_s, devices / POLLS_PER_S)
        self.hosts.reporting = replace(policy.reporting, period_s=min(period_s, PERIODS_S[1]))

    def _send(self, host: str, message: Message) -> None:
        place = self.hosts.states[host].place
        datapath = self.datapaths.get(place.dpid)
        if datapath is None:
            return  # its switch is gone
        payload = self.hosts.seal(host, message, self._next_number())
        frame = Frame(
            CONTROLLER_MAC,
            place.mac,
            self.address,
            place.address,
            DEVICE_PORT,
            DEVICE_PORT,
            payload,
        )
        out = flow_entries.packet_out(datapath, ofproto.OFPP_CONTROLLER, place.port, frame.encode())
        datapath.send_msg(out)

    def _next_number(self) -> int:
        self._number = max(self._number + 1, time.time_ns())
        return self._number
