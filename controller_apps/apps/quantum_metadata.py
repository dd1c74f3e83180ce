"""Quantum metadata: reads set-up messages and opens light paths before it releases them.

The arbiter decides, `Switches` turns its actions into OpenFlow, `Journal` writes them down. All
state belongs to this app's own thread: the clock is an event, too.
"""

import time
from collections.abc import Callable
from hashlib import blake2b
from itertools import count
from math import inf
from typing import Any

from controller_apps.apps.host_commands import (
    EventAlarm,
    EventCommand,
    EventEstimate,
    EventMonitorOver,
    EventNodeAnswered,
    EventSessionReported,
)
from controller_apps.apps.journal import Journal
from controller_apps.apps.ticks import Instants, Ticks
from controller_apps.console.questions import EventQuestion, Refused, reply
from controller_apps.console.views import (
    fibers_view,
    node_features_view,
    paths_view,
    sessions_view,
)
from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.openflow import flow_entries
from controller_apps.openflow.discovery import Identities
from controller_apps.openflow.fibers import Fibers
from controller_apps.openflow.framework import (
    CONFIG,
    DEAD,
    MAIN,
    App,
    Datapath,
    Event,
    hub,
    ofp_event,
    ofproto,
    on,
    shows_life,
)
from controller_apps.openflow.mac_table import MacTable
from controller_apps.openflow.switches import Switches
from controller_apps.packets import FiveTuple, is_tcp
from controller_apps.policy.policy import CLOSE, Policy
from controller_apps.policy.reading import DEFAULT, BadPolicy, read_policy, require_network
from controller_apps.record import Record
from controller_apps.sessions.actions import (
    Action,
    Command,
    Drop,
    Forget,
    Keep,
    Note,
)
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.idle_light import IdleLight
from controller_apps.sessions.link_monitors import NO_LINKS, PREEMPTED, LinkMonitors
from controller_apps.sessions.permission import Permission
from controller_apps.sessions.snapshot import encode_hosts
from controller_apps.sessions.state_folder import StateFolder, take_over
from controller_apps.timeouts import DISCOVERY_S, SESSION_TICK_S, WATCH_TICK_S
from wire.analyser_frames import ETHER_TYPE, HERALDS
from wire.config import ControllerConfig
from wire.malformed import MalformedPacket
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason
from wire.network_time import WATCH, NetworkTime
from wire.parameters.network import OFF, REQUIRED

DEVICE_MONITOR = "DeviceMonitor"  # the app that speaks to the hosts


class EventTick(Event):
    """Time has passed."""


class EventWatchTick(Event):
    """The next link monitor may be due."""


class EventInstantOver(Event):
    """Nothing more comes at this instant."""


class QuantumMetadata(App):
    OFP_VERSIONS = (ofproto.OFP_VERSION,)
    _kept_hosts: object = None

    def __init__(
        self,
        config: ControllerConfig,
        mac_table: MacTable,
        record: Record,
        state: StateFolder,
        **contexts: Any,
    ) -> None:
        super().__init__(**contexts)
        self.time, self.stations, self.policy_path = config.time, config.stations, config.policy
        self.metadata_at_switch = config.metadata_at_switch
        self.mac_table, self.state = mac_table, state
        self._ticks = Ticks(config.time, SESSION_TICK_S)
        self._watch_ticks = Ticks(config.time, WATCH_TICK_S, WATCH)
        self._held = False  # whether messages waited for switches at the last look
        names = {dpid: name for name, dpid in config.quantum_switches.items()}
        self.network = Network(names=names)
        self.arbiter = _arbiter(self.network, config)
        sessions = self.arbiter.sessions
        trunks = config.trunks if config.metadata_at_switch != OFF else []
        self.switches = Switches(frozenset(names), mac_table, _bypass_timeout_s(config), trunks)
        self.journal = Journal(
            record, self.network, sessions, self.logger, lambda: time.monotonic(), config.time
        )
        self.journal.copied = bool(trunks)
        identities = Identities(config.device_keys, config.addresses)
        self.fibers = Fibers(self.network, record, self.logger, identities)
        self.permission = Permission(self._read_policy(), self.network, sessions)
        self.arbiter.terms.forbid = self._forbid
        self.monitors = LinkMonitors(self.network)
        self.idle = IdleLight(self.network, sessions, self._find_idle, session_numbers(config.time))
        self._follow_policy()
        self._performers = self._actions()
        for number in take_over(state, self.arbiter, self.logger, self._now()):
            self._note(Note("resumed", number))
            self.monitors.granted(sessions.by_number.get(number))
        self._instants = Instants(
            config.time, lambda: self.send_event(self.name, EventInstantOver())
        )
        self._keep_hosts()

    def start(self) -> Any:
        """Begin to handle events; called by the framework."""
        super().start()
        hub.spawn(self._tick_for_ever)
        hub.spawn(self._watch_for_ever)
        self._instants.start()

    def close(self) -> None:
        """Keep the state for the next controller, and record the end."""
        self._keep_hosts()
        self.journal.close()

    def _tick_for_ever(self) -> None:
        while True:
            self._ticks.wait(self.arbiter.next_slot_s(self._now()))
            self.send_event(self.name, EventTick())

    def _watch_for_ever(self) -> None:
        while True:
            self._watch_ticks.wait(self.idle.next_s if self.time.has_begun else inf)
            self.send_event(self.name, EventWatchTick())

    def _now(self) -> float:
        """Return the time of the network, by which sessions go; discovery goes by the wall."""
        return self.time.now_s()

    @on(EventTick)
    def time_passed(self, event: Any) -> None:
        self.fibers.time_passed(self._ticks.now_s())
        self.journal.time_passed()
        self._keep_hosts()
        self._do(self.arbiter.tick(self._now()))

    @on(EventWatchTick)
    def watch_goes_on(self, event: Any) -> None:
        """Seal what is idle, once the network is ready."""
        if self.time.has_begun:
            self._do(self.idle.tick(self._now()))

    # Actions

    def _actions(self) -> dict[type[Action], Callable[[Any], None]]:
        return {
            Note: self._note,
            Drop: self.journal.drop,
            Keep: self._keep,
            Forget: lambda action: self.state.forget_session(action.session),
            Command: lambda action: self._tell_monitor(EventCommand(action)),
        }

    def _do(self, actions: list[Action]) -> None:
        for action in actions:
            self._performers.get(type(action), self.switches.send)(action)
        if self.arbiter.holds or self._held:
            self._ticks.wake_by(lambda: self.arbiter.next_slot_s(self._now()))
        self._held = self.arbiter.holds

    def _tell_monitor(self, event: Event) -> None:
        self.send_event(DEVICE_MONITOR, event)

    def _keep(self, keep: Keep) -> None:
        self._keep_hosts()
        self.state.keep_session(keep.session, keep.data)

    def _keep_hosts(self) -> None:
        """Keep the places of hosts if they have changed: not at each of a thousand discoveries."""
        hosts = self.network.hosts
        if hosts is not self._kept_hosts:
            self.state.keep_hosts(encode_hosts(hosts))
            self._kept_hosts = hosts

    def _note(self, note: Note) -> None:
        if note.event in ("granted", "moved"):
            self.monitors.granted(self.arbiter.sessions.by_number.get(note.session))
        if note.event in ("refused", "torn_down"):
            self.idle.over(note.session, self._now())
            self._watch_ticks.wake_by(lambda: self.idle.next_s)
        if note.event == "torn_down" and note.detail == PREEMPTED:
            self.monitors.forget(note.session)
        self.journal.note(note)

    # Switches

    @on(ofp_event.EventOFPSwitchFeatures, CONFIG)
    def switch_named(self, event: Any) -> None:
        """Do nothing: the framework ends an impostor's connection before it calls a handler."""

    @on(ofp_event.EventOFPStateChange, MAIN, DEAD)
    def switch_changed(self, event: Any) -> None:
        """Prepare a switch that has connected, end what used one that is gone."""
        datapath = event.datapath
        before = self.switches.datapaths.get(datapath.id)
        if event.state == DEAD and before is not datapath:
            return  # its successor is connected already, or it never sent its id
        if before is not None:
            self.switches.disconnect(datapath.id)
            self.fibers.switch_left(datapath.id)
            self._do(self.arbiter.switch_left(datapath.id, self._now()))
            self.logger.info("switch %#x is gone", datapath.id)
        if event.state == MAIN:
            self.switches.connect(datapath)
            if datapath.id in self.switches.quantum:  # of use when its optics are known
                self.fibers.switch_here(datapath, self._ticks.now_s())

    @on(ofp_event.EventOFPExperimenterStatsReply, CONFIG, MAIN)
    def optics_reported(self, event: Any) -> None:
        if self.fibers.learn(event.msg):
            self._optics_known(event.msg.datapath.id)

    def _optics_known(self, dpid: int) -> None:
        if dpid not in self.network.connected:
            self.network.connected.add(dpid)
            self.journal.switch_ready(dpid, "quantum")
        self._network_changed()

    def _network_changed(self) -> None:
        self._do(self.arbiter.network_changed(self._now()))

    @on(ofp_event.EventOFPPortStatsReply, CONFIG, MAIN)
    def ports_measured(self, event: Any) -> None:
        if event.msg.datapath.id in self.switches.quantum:
            self.fibers.measured(event.msg)

    @on(ofp_event.EventOFPFlowStatsReply, CONFIG, MAIN)
    def flows_listed(self, event: Any) -> None:
        """Compare the entries of a switch with living sessions."""
        message, now = event.msg, self._now()
        if (count := self.switches.counted(message)) is not None:
            five_tuple, byte_count = count
            self._do(self.arbiter.bypass_counted(five_tuple, byte_count, now))
        entries = self.switches.listed(message)
        if entries is None:
            return
        dpid = message.datapath.id
        if dpid in self.switches.quantum:
            paths = [
                (entry.cookie, flow_entries.hop_of(dpid, entry))
                for entry in entries
                if flow_entries.is_path(entry)
            ]
            self._do(self.arbiter.entries_found(dpid, paths))
        else:
            self._bypasses_listed(message.datapath, [entry for entry in entries if entry.cookie])

    def _bypasses_listed(self, datapath: Datapath, entries: list[Any]) -> None:
        bypasses = []
        for entry in entries:
            connection = flow_entries.bypassed(entry)
            if connection is not None:
                bypasses.append((entry.cookie, connection))
            else:
                self.switches.delete_entry(datapath, entry)
        self._do(self.arbiter.bypasses_found(datapath.id, bypasses))

    @on(ofp_event.EventOFPPacketIn, MAIN)
    def packet_arrived(self, event: Any) -> None:
        """Pass LLDP to discovery and metadata to the arbiter; leave other frames to other apps."""
        message = event.msg
        self.journal.packet_came(bytes(message.data))
        if message.table_id == flow_entries.LEARNING_TABLE:
            return
        at, frame = (
            SwitchPort(message.datapath.id, message.match["in_port"]),
            bytes(message.data),
        )
        if at.dpid in self.switches.quantum and is_tcp(frame):
            if message.reason != ofproto.OFPR_PACKET_OUT:  # it came on copper
                self._do(self.arbiter.copy_arrived(at, frame, self._now()))
        elif at.dpid in self.switches.quantum and frame[12:14] in (HERALDS, ETHER_TYPE):
            self._do(self.arbiter.inner_frame(at, message.cookie, frame))
        elif frame[12:14] == HERALDS:
            self._do(self.arbiter.host_frame(at, frame))
        elif at.dpid in self.switches.quantum:
            self._lldp_arrived(at, frame)
        elif is_tcp(frame) and not self._instants.keeps(at, frame):
            self._segment_arrived(at, frame)

    def _segment_arrived(self, at: SwitchPort, frame: bytes) -> None:
        self._do(self.arbiter.segment_arrived(at.dpid, at.port, frame, self._now()))

    @on(EventInstantOver)
    def instant_over(self, event: Any) -> None:
        """Pass the segments that came at this instant to the arbiter."""
        for at, frame in self._instants.take():
            self._segment_arrived(at, frame)
        self._instants.go_on()

    def _lldp_arrived(self, at: SwitchPort, frame: bytes) -> None:
        try:
            is_new = self.fibers.spoke(at, frame, self._ticks.now_s())
        except MalformedPacket as error:
            self.journal.drop(Drop("lldp", str(error), at))
            return
        if is_new:
            self._network_changed()

    @on(ofp_event.EventOFPPortStatus, MAIN)
    def port_changed(self, event: Any) -> None:
        """Note a port whose fibre was cut or mended, and move the sessions that it has cut off."""
        quantum = event.msg.datapath.id in self.switches.quantum
        if quantum and self.fibers.port_changed(event.msg, self._ticks.now_s()):
            self._network_changed()

    @on(ofp_event.EventOFPBarrierReply, CONFIG, MAIN)
    def barrier_passed(self, event: Any) -> None:
        shows_life(event.msg.datapath)
        dpid, xid = event.msg.datapath.id, event.msg.xid
        if kind := self.switches.prepared(dpid, xid):
            self.journal.switch_ready(dpid, kind)
        transaction = self.switches.end_transaction(dpid, xid)
        if transaction is not None:
            self._do(self.arbiter.barrier_passed(dpid, transaction, self._now()))

    @on(ofp_event.EventOFPErrorMsg, CONFIG, MAIN)
    def switch_refused(self, event: Any) -> None:
        error = event.msg
        dpid = error.datapath.id or 0  # 0: not yet known
        if self.fibers.silent(dpid, error.xid):
            self._optics_known(dpid)
            return
        code = getattr(error, "code", "of an experimenter")
        self.logger.warning("switch %#x: error type %d, code %s", dpid, error.type, code)
        transaction = self.switches.transaction_of(dpid, error.xid)
        if transaction is not None:
            self._do(self.arbiter.switch_refused(transaction, self._now()))

    @on(ofp_event.EventOFPFlowRemoved, MAIN)
    def entry_removed(self, event: Any) -> None:
        """Report to the arbiter that a connection has fallen silent."""
        message = event.msg
        dpid = message.datapath.id
        idle = message.reason == ofproto.OFPRR_IDLE_TIMEOUT
        if dpid in self.switches.quantum or not idle:
            return
        if message.priority == flow_entries.BYPASS_PRIORITY:
            connection = flow_entries.five_tuple_of(message.match)
            self._do(self.arbiter.bypass_expired(dpid, connection, self._now()))

    # Hosts

    @on(EventNodeAnswered)
    def node_answered(self, event: EventNodeAnswered) -> None:
        """Report the answer of a link monitor's host to a command."""
        session, node, reason = event.session, event.node, event.reason
        self._do(self.idle.node_answered(session, node, reason, self._now()))

    @on(EventSessionReported)
    def session_reported(self, event: EventSessionReported) -> None:
        """Report whether a host takes part in a session that was taken over."""
        session, node, reason = event.session, event.node, event.reason
        self._do(self.arbiter.session_reported(session, node, reason, self._now()))

    @on(EventAlarm)
    def monitor_alarmed(self, event: EventAlarm) -> None:
        """Close the links of a monitor with an alarm, if the policy says so."""
        links = self.monitors.watched(event.session, event.place.address)
        closes = self.permission.policy.alarm == CLOSE and bool(links)
        self.journal.alarm(event.session, event.host, event.place, links, closes)
        if closes:
            self.monitors.close(links)
            self._follow_policy()
            self._network_changed()

    @on(EventMonitorOver)
    def monitor_over(self, event: EventMonitorOver) -> None:
        """Record the result of a link monitor, from the host that opened it alone."""
        number = event.report.monitor
        if self.monitors.is_of(number, event.address):
            links = self.monitors.watched(number, event.address)
            self.journal.monitor_over(event.host, event.report, links)

    @on(EventEstimate)
    def estimate_reported(self, event: EventEstimate) -> None:
        """Record an estimate of a session's light, from one of its ends alone."""
        if self.arbiter.sessions.is_end(event.estimate.about, event.address):
            self.journal.estimate(event.host, event.estimate)

    def _find_idle(self, setup: Setup, connection: FiveTuple) -> Admission:
        return self.arbiter.terms.find_light(setup, connection, self.arbiter.sessions)

    # The policy

    def _forbid(self, setup: Setup, connection: FiveTuple) -> Admission | None:
        if self.idle.ordered(setup, connection):
            return None  # the policy's own
        objection = self.permission.objection(setup, connection)
        if not objection:
            return None
        detail = self.journal.forbidden(setup, connection, objection)
        return Admission(Reason.NOT_ALLOWED, detail=detail)

    @on(EventQuestion)
    def asked(self, question: Any) -> None:
        sessions, network = self.arbiter.sessions, self.network
        handlers = {
            "sessions": lambda: sessions_view(sessions, network, self._now()),
            "paths": lambda: paths_view(sessions, network),
            "fibers": lambda: fibers_view(network),
            "node_features": lambda: node_features_view(network),
            "reload": self._reload_policy,
        }
        reply(question, handlers)

    def _read_policy(self) -> Policy:
        policy = read_policy(self.policy_path)
        require_network(policy, self.network.names.values(), self.metadata_at_switch)
        return policy

    def _reload_policy(self) -> str:
        try:
            self.permission.policy = self._read_policy()
        except BadPolicy as error:
            raise Refused(f"{error}; the policy before stays in force") from error
        self.monitors.closed = NO_LINKS
        self._follow_policy()
        self.journal.policy(self.policy_path)
        self._network_changed()
        return self.policy_path or str(DEFAULT)

    def _follow_policy(self) -> None:
        policy = self.permission.policy
        self.arbiter.follow(policy)
        self.fibers.needs_seal = policy.filter.announcements
        self.network.closed = policy.closed | self.monitors.closed
        self.idle.follow(policy.watches, self._now())
        stations = self.stations if policy.filter.addresses else []
        self.mac_table.place(stations)
        self.switches.check_addresses(stations)


def _bypass_timeout_s(config: ControllerConfig) -> int:
    """Return it in whole seconds of the wall clock, by which Open vSwitch counts it."""
    idle_s = min(round(config.time.wall_s(config.idle_timeout_s)), 0xFFFF)
    return config.time.switch_timeout_s(idle_s)


def _arbiter(network: Network, config: ControllerConfig) -> Arbiter:
    return Arbiter(
        network,
        config.hold_timeout_s,
        config.idle_timeout_s,
        config.loss_budget_db,
        queues=config.contention == "queue",
        needs_copies=config.metadata_at_switch == REQUIRED,
        keys={at: config.device_keys[host] for host, at in config.addresses.items()},
        discovery_s=max(DISCOVERY_S, config.announcement_period_s),
    )


def session_numbers(network_time: NetworkTime) -> Callable[[], int]:
    """Return a function that returns another session number at each call, of no opener's.

    Those of a controller that is started again are others, as time has gone on.
    """
    numbers = count()

    def name() -> str:
        return f"seal/{network_time.now_ns() - network_time.since_ns}/{next(numbers)}"

    return lambda: int.from_bytes(blake2b(name().encode(), digest_size=8).digest(), "big")
