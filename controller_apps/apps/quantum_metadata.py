"""Quantum metadata: reads set-up messages and opens light paths before it lets them on.

The thinking is the arbiter's; this turns OpenFlow into its calls and its actions into
OpenFlow. All state belongs to this app's own thread: the clock comes as an event, too.
"""

import time
from collections import Counter
from hashlib import blake2b
from itertools import count
from logging import WARNING
from math import inf
from typing import Any

from controller_apps.apps.host_orders import (
    EventAlarm,
    EventEstimate,
    EventNodeAnswered,
    EventOrder,
    EventSealOver,
    EventSessionReported,
    EventSwapsOrdered,
)
from controller_apps.console.questions import EventQuestion, Refused, reply
from controller_apps.console.views import (
    fibers_view,
    light_view,
    name_of,
    node_features_view,
    paths_view,
    request_view,
    sessions_view,
)
from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network
from controller_apps.openflow import flow_entries, optical_messages
from controller_apps.openflow.fibers import Fibers
from controller_apps.openflow.framework import (
    CONFIG,
    DEAD,
    MAIN,
    App,
    Event,
    hub,
    ofp_event,
    ofproto,
    on,
    shows_life,
)
from controller_apps.openflow.identities import Identities
from controller_apps.openflow.mac_table import MacTable, filter_entries
from controller_apps.openflow.path_bundles import path_bundle, xid_of
from controller_apps.packets.segments import FiveTuple, is_tcp
from controller_apps.policy.policy import CLOSE
from controller_apps.policy.reading import DEFAULT, BadPolicy, read_policy, require_switches
from controller_apps.port_lines import PortLines
from controller_apps.record import Record
from controller_apps.sessions.actions import (
    Action,
    AddBypass,
    ClosePaths,
    CountBypass,
    Drop,
    Forget,
    Forward,
    Keep,
    Note,
    OpenPaths,
    Order,
    RemoveBypass,
    SwapsOrdered,
)
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.idle_light import IdleLight
from controller_apps.sessions.permission import Permission
from controller_apps.sessions.preempted import PREEMPTED
from controller_apps.sessions.restore import take_over
from controller_apps.sessions.seals import Seals, names_of
from controller_apps.sessions.snapshot import encode_hosts
from controller_apps.sessions.state_folder import StateFolder
from controller_apps.timeouts import DISCOVERY_S, SESSION_TICK_S
from wire.config import ControllerConfig
from wire.malformed import MalformedPacket
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service
from wire.session_estimates import Quantity

DEVICE_MONITOR = "DeviceMonitor"  # the app that speaks to the hosts
NOWHERE = SwitchPort(0, 0)  # what nobody has sent


class EventTick(Event):
    """Time has passed."""


class QuantumMetadata(App):
    """Arbitrates light between hosts."""

    OFP_VERSIONS = (ofproto.OFP_VERSION,)

    def __init__(
        self,
        config: ControllerConfig,
        mac_table: MacTable,
        record: Record,
        state: StateFolder,
        **contexts: Any,
    ) -> None:
        super().__init__(**contexts)
        self.quantum_switches = frozenset(config.quantum_switches.values())
        self.time = config.time
        # Open vSwitch counts it, on the wall clock.
        self.bypass_timeout_s = min(round(config.time.wall_s(config.idle_timeout_s)), 0xFFFF)
        self.mac_table = mac_table
        self.record = record
        names = {dpid: name for name, dpid in config.quantum_switches.items()}
        self.network = Network(names=names)
        self.arbiter = Arbiter(
            self.network,
            config.hold_timeout_s,
            config.idle_timeout_s,
            config.loss_budget_db,
            config.contention == "queue",
            keys={at: config.device_keys[host] for host, at in config.addresses.items()},
            discovery_s=max(DISCOVERY_S, config.announcement_period_s),
        )
        identities = Identities(config.device_keys, config.addresses)
        self.fibers = Fibers(self.network, record, self.logger, identities)
        self.policy_path = config.policy
        policy = read_policy(config.policy)
        require_switches(policy, names.values())
        self.permission = Permission(policy, self.network, self.arbiter.sessions)
        self.arbiter.terms.forbid = self._forbid
        self.seals = Seals(self.network)
        self._seal_names = (f"{time.time_ns()}/{number}" for number in count())
        sessions = self.arbiter.sessions
        self.idle = IdleLight(self.network, sessions, self._find_idle, self._new_seal)
        self.stations = config.stations
        self.datapaths: dict[int, Any] = {}
        self._follow_policy()
        self.packet_in_count = 0
        self.dropped: Counter[str] = Counter()
        self._port_lines = PortLines(self.logger)
        self._xids = count(1)
        # By switch and xid: entries of unfinished replies, transactions of the arbiter.
        self._listed: dict[tuple[int, int], list[Any]] = {}
        self._transactions: dict[tuple[int, int], int] = {}
        self._counting: dict[tuple[int, int], FiveTuple] = {}
        self._taking_in: dict[tuple[int, int], str] = {}  # kinds of switches, by barrier
        self.state = state
        for number in take_over(state, self.arbiter, self.logger, self._now()):
            self._note(Note("resumed", number))
            self.seals.granted(self.arbiter.sessions.by_number.get(number))
        self._hosts_kept: object = None
        self._keep_hosts()

    def start(self) -> Any:
        """Begin to handle events; called by the framework."""
        super().start()
        hub.spawn(self._tick_for_ever)

    def _keep_hosts(self) -> None:
        """Keep where hosts are, if that has changed: not at each of a thousand that are found."""
        hosts = self.network.hosts
        if hosts is not self._hosts_kept:
            self.state.keep_hosts(encode_hosts(hosts))
            self._hosts_kept = hosts

    def _tick_for_ever(self) -> None:
        while True:
            hub.sleep(min(SESSION_TICK_S, self._until_next_slot_s()))
            self.send_event(self.name, EventTick())

    def _until_next_slot_s(self) -> float:
        now = self._now()
        return self.time.wall_s(self.arbiter.next_slot_s(now) - now)

    @on(EventTick)
    def time_passed(self, event: Any) -> None:
        """Do what is due."""
        self.fibers.time_passed(time.monotonic())
        self._port_lines.time_passed(time.monotonic())
        self._keep_hosts()
        self._do(self.arbiter.tick(self._now()))
        self._do(self.idle.tick(self._now()))

    def _now(self) -> float:
        """Return the time of the network, by which sessions go; discovery goes by the wall."""
        return self.time.network_s(time.monotonic())

    @on(ofp_event.EventOFPSwitchFeatures, CONFIG)
    def switch_named(self, event: Any) -> None:
        """Be there: whoever poses as a switch is sent away before a handler is called."""

    @on(ofp_event.EventOFPStateChange, MAIN, DEAD)
    def switch_changed(self, event: Any) -> None:
        """Take in a switch that has connected, end what used one that is gone."""
        datapath = event.datapath
        known = self.datapaths.get(datapath.id)
        if event.state == DEAD and known is not datapath:
            return  # its successor is here already, or it never said who it was
        if known is not None:
            del self.datapaths[datapath.id]
            for table in (self._transactions, self._listed, self._counting, self._taking_in):
                for key in [key for key in table if key[0] == datapath.id]:
                    del table[key]
            self.fibers.switch_left(datapath.id)
            self._do(self.arbiter.switch_left(datapath.id, self._now()))
            self.logger.info("switch %#x is gone", datapath.id)
        if event.state == MAIN:
            self._take_in(datapath)

    def _take_in(self, datapath: Any) -> None:
        self.datapaths[datapath.id] = datapath
        if datapath.id not in self.quantum_switches:
            self._filter(datapath)
            for message in flow_entries.metadata_entries(datapath):
                datapath.send_msg(message)
            self._ask_entries(datapath, flow_entries.METADATA_TABLE)
            self._ask_barrier(datapath)
            return
        datapath.send_msg(flow_entries.discovery_entry(datapath))
        for message in flow_entries.classical_entries(datapath):
            datapath.send_msg(message)
        self._ask_entries(datapath, flow_entries.LIGHT_TABLE)
        self.fibers.switch_here(datapath, time.monotonic())  # of use when it has told its optics

    def _ask_entries(self, datapath: Any, table: int) -> None:
        question = flow_entries.ask_entries(datapath, table)
        datapath.send_msg(question)
        self._listed[datapath.id, question.xid] = []

    def _ask_barrier(self, datapath: Any) -> None:
        """Let a classical switch say when it has taken in all entries: it is ready then."""
        question = flow_entries.barrier(datapath)
        datapath.send_msg(question)
        self._taking_in[datapath.id, question.xid] = "classical"

    def _ready(self, dpid: int, kind: str) -> None:
        self.logger.info("%s switch %#x connected", kind, dpid)
        self.record.write("switch", dpid=dpid, kind=kind)

    @on(ofp_event.EventOFPExperimenterStatsReply, CONFIG, MAIN)
    def optics_told(self, event: Any) -> None:
        """Take in what a switch does to light."""
        if self.fibers.learn(event.msg):
            self._optics_known(event.msg.datapath.id)

    def _optics_known(self, dpid: int) -> None:
        if dpid not in self.network.connected:
            self.network.connected.add(dpid)
            self._ready(dpid, "quantum")
        self._do(self.arbiter.network_changed(self._now()))

    @on(ofp_event.EventOFPPortStatsReply, CONFIG, MAIN)
    def ports_measured(self, event: Any) -> None:
        """Take in what the ports of a quantum switch measure."""
        if event.msg.datapath.id in self.quantum_switches:
            self.fibers.measured(event.msg)

    @on(ofp_event.EventOFPFlowStatsReply, CONFIG, MAIN)
    def flows_listed(self, event: Any) -> None:
        """Make what a switch has kept of its past what living sessions asked for."""
        dpid, xid = event.msg.datapath.id, event.msg.xid
        if (dpid, xid) in self._counting:
            count = sum(entry.byte_count for entry in event.msg.body)
            five_tuple = self._counting.pop((dpid, xid))
            self._do(self.arbiter.bypass_counted(five_tuple, count, self._now()))
        if (dpid, xid) not in self._listed:
            return  # somebody else has asked
        self._listed[dpid, xid] += event.msg.body
        if event.msg.flags & ofproto.OFPMPF_REPLY_MORE:
            return
        entries = self._listed.pop((dpid, xid))
        if dpid in self.quantum_switches:
            found = [
                (entry.cookie, flow_entries.hop_of(dpid, entry))
                for entry in entries
                if flow_entries.is_path(entry)
            ]
            self._do(self.arbiter.entries_found(dpid, found))
        else:
            self._bypasses_listed(event.msg.datapath, [entry for entry in entries if entry.cookie])

    def _bypasses_listed(self, datapath: Any, entries: list[Any]) -> None:
        found = []
        for entry in entries:
            connection = flow_entries.bypassed(entry)
            if connection is not None:
                found.append((entry.cookie, connection))
            else:  # of somebody else; this table is ours
                table = flow_entries.METADATA_TABLE
                datapath.send_msg(flow_entries.delete_entry(datapath, table, entry))
        self._do(self.arbiter.bypasses_found(datapath.id, found))

    @on(ofp_event.EventOFPPacketIn, MAIN)
    def packet_arrived(self, event: Any) -> None:
        """Hand LLDP to discovery and metadata to the arbiter; the rest is not ours."""
        self.packet_in_count += 1
        message = event.msg
        dpid, in_port, frame = message.datapath.id, message.match["in_port"], bytes(message.data)
        if message.table_id == flow_entries.LEARNING_TABLE:
            return
        at = SwitchPort(dpid, in_port)
        if dpid in self.quantum_switches:
            self._fiber_spoke(at, frame)
        elif is_tcp(frame):
            self._do(self.arbiter.segment_arrived(dpid, in_port, frame, self._now()), at)

    def _fiber_spoke(self, at: SwitchPort, frame: bytes) -> None:
        try:
            news = self.fibers.spoke(at, frame, time.monotonic())
        except MalformedPacket as error:
            self._drop(Drop("lldp", str(error)), at)
            return
        if news:
            self._do(self.arbiter.network_changed(self._now()))

    @on(ofp_event.EventOFPPortStatus, MAIN)
    def port_changed(self, event: Any) -> None:
        """Note a port whose fibre was cut or mended, and move what it has cut off."""
        quantum = event.msg.datapath.id in self.quantum_switches
        if quantum and self.fibers.port_changed(event.msg, time.monotonic()):
            self._do(self.arbiter.network_changed(self._now()))

    @on(ofp_event.EventOFPBarrierReply, CONFIG, MAIN)
    def barrier_passed(self, event: Any) -> None:
        """Tell the arbiter that a switch is ready."""
        shows_life(event.msg.datapath)
        dpid, xid = event.msg.datapath.id, event.msg.xid
        if (dpid, xid) in self._taking_in:
            self._ready(dpid, self._taking_in.pop((dpid, xid)))
        transaction = self._transactions.get((dpid, xid))
        if transaction is None:
            return
        while self._transactions.get((dpid, xid)) == transaction:  # back to the bundle's begin
            del self._transactions[dpid, xid]
            xid -= 1
        self._do(self.arbiter.barrier_passed(dpid, transaction, self._now()))

    @on(ofp_event.EventOFPErrorMsg, CONFIG, MAIN)
    def switch_refused(self, event: Any) -> None:
        """Tell the arbiter that a switch will not do it."""
        error = event.msg
        dpid = error.datapath.id or 0  # 0: not yet known
        if self.fibers.silent(dpid, error.xid):
            self._optics_known(dpid)
            return
        code = getattr(error, "code", "of an experimenter")
        self.logger.warning("switch %#x: error type %d, code %s", dpid, error.type, code)
        transaction = self._transactions.get((dpid, error.xid))
        if transaction is not None:
            self._do(self.arbiter.switch_refused(transaction, self._now()))

    @on(ofp_event.EventOFPFlowRemoved, MAIN)
    def entry_removed(self, event: Any) -> None:
        """Tell the arbiter that a connection has fallen silent."""
        message = event.msg
        classical = message.datapath.id not in self.quantum_switches
        idle = message.reason == ofproto.OFPRR_IDLE_TIMEOUT
        if classical and idle and message.priority == flow_entries.BYPASS_PRIORITY:
            connection = flow_entries.five_tuple_of(message.match)
            switch = message.datapath.id
            self._do(self.arbiter.bypass_expired(switch, connection, self._now()))

    @on(EventNodeAnswered)
    def node_answered(self, event: Any) -> None:
        """Tell the arbiter that a node of a chain has, or will not; likewise a host of a seal."""
        answered = event.session, event.node, event.reason, self._now()
        self._do(self.arbiter.node_answered(*answered))
        self._do(self.idle.node_answered(*answered))

    @on(EventSessionReported)
    def session_reported(self, event: Any) -> None:
        """Tell the arbiter whether a host takes part in a session that was taken over."""
        told = event.session, event.node, event.reason
        self._do(self.arbiter.session_reported(*told, self._now()))

    @on(EventAlarm)
    def seal_alarmed(self, event: Any) -> None:
        """Close the way on which a seal has found somebody, if the policy says so."""
        ways = self.seals.watched(event.session, event.place.address)
        closes = self.permission.policy.alarm == CLOSE and bool(ways)
        watched = names_of(ways)
        text = f"{event.host}: alarm of its seal {event.session:016x} on {watched}"
        self._port_lines.add(event.place.at, text, time.monotonic(), WARNING)
        facts = {"session": f"{event.session:016x}", "host": event.host, "watched": watched}
        self.record.write("alarm", **facts, closed=closes)
        if closes:
            self.seals.close(ways)
            self._follow_policy()
            self._do(self.arbiter.network_changed(self._now()))

    @on(EventSealOver)
    def seal_over(self, event: Any) -> None:
        """Record what a seal has seen of the fibres that it has watched."""
        told = event.report
        if not self.seals.is_of(told.seal, event.address):
            return  # it says what it likes
        self.record.write(
            "watched",
            session=f"{told.seal:016x}",
            host=event.host,
            watched=names_of(self.seals.watched(told.seal, event.address)),
            compared=told.seal_compared,
            errors=told.seal_errors,
            tests_whole=told.seal_tests,
            alarm=told.alarm == told.seal,
            end=Reason(told.seal_end).name,
        )

    @on(EventEstimate)
    def estimate_told(self, event: Any) -> None:
        """Record what an end of a session has found out about its light."""
        told = event.told
        if not self.arbiter.sessions.is_end(told.about, event.address):
            return  # it says what it likes
        self.record.write(
            "estimate",
            session=f"{told.about:016x}",
            host=event.host,
            quantity=Quantity(told.quantity).name.lower(),
            **told.interval._asdict(),
        )

    def _find_idle(self, setup: Setup, connection: FiveTuple) -> Admission:
        """Return light for a seal that is to begin."""
        return self.arbiter.terms.find_light(setup, connection, self.arbiter.sessions)

    def _new_seal(self) -> int:
        """Return the number of a session that nobody else makes."""
        name = f"seal/{next(self._seal_names)}"
        return int.from_bytes(blake2b(name.encode(), digest_size=8).digest(), "big")

    @on(EventQuestion)
    def asked(self, question: Any) -> None:
        """Answer what another thread wants to know."""
        handlers = {
            "sessions": lambda: sessions_view(self.arbiter.sessions, self.network, self._now()),
            "paths": lambda: paths_view(self.arbiter.sessions, self.network),
            "fibers": lambda: fibers_view(self.network),
            "node_features": lambda: node_features_view(self.network),
            "reload": self._reload_policy,
        }
        reply(question, handlers)

    def _forbid(self, setup: Setup, five_tuple: FiveTuple) -> Admission | None:
        if self.idle.ordered(setup, five_tuple):
            return None  # the policy's own
        objection = self.permission.objection(setup, five_tuple)
        if not objection:
            return None
        ends = [name_of(self.network, end) for end in (five_tuple.source, five_tuple.destination)]
        service = Service(setup.service).name.lower()
        told = {"service": service, "from": ends[0], "to": ends[1], "detail": objection}
        self.record.write("forbidden", session=f"{setup.session:016x}", **told)
        return Admission(Reason.NOT_ALLOWED, detail=f"{' to '.join(ends)}: {objection}")

    def _reload_policy(self) -> str:
        try:
            policy = read_policy(self.policy_path)
            require_switches(policy, self.network.names.values())
        except BadPolicy as error:
            raise Refused(f"{error}; the policy before stays in force") from error
        self.permission.policy = policy
        self.seals.closed = frozenset()
        self._follow_policy()
        self.record.write("policy", path=self.policy_path)
        self._do(self.arbiter.network_changed(self._now()))
        return self.policy_path or str(DEFAULT)

    def _follow_policy(self) -> None:
        policy = self.permission.policy
        self.arbiter.follow(policy)
        self.fibers.needs_seal = policy.filter.announcements
        self.mac_table.place(self.stations if policy.filter.addresses else [])
        self.network.closed = policy.closed | self.seals.closed
        self.idle.follow(policy.watches, self._now())
        for dpid, datapath in self.datapaths.items():
            if dpid not in self.quantum_switches:
                self._filter(datapath)

    def _filter(self, datapath: Any) -> None:
        stations = self.stations if self.permission.policy.filter.addresses else []
        entries = filter_entries(datapath, stations)
        flow_entries.send(datapath, flow_entries.with_barriers(datapath, entries))

    def close(self) -> None:
        """Keep what there is, say what lines were left out, and record the end."""
        self._port_lines.time_passed(inf)
        self._keep_hosts()
        self.record.write("stopped", packet_in_count=self.packet_in_count)

    def _do(self, actions: list[Action], at: SwitchPort = NOWHERE) -> None:
        """Do what the arbiter says, which a segment that has come at a port has made it say."""
        for action in actions:
            if isinstance(action, Note):
                self._note(action)
            elif isinstance(action, Drop):
                self._drop(action, at)
            elif isinstance(action, Keep):
                self._keep_hosts()
                self.state.keep_session(action.session, action.data)
            elif isinstance(action, Forget):
                self.state.forget_session(action.session)
            elif isinstance(action, SwapsOrdered):
                self.send_event(DEVICE_MONITOR, EventSwapsOrdered(action))
            elif isinstance(action, Order):
                self.send_event(DEVICE_MONITOR, EventOrder(action))
            elif action.dpid in self.datapaths:  # what is gone needs nothing
                datapath = self.datapaths[action.dpid]
                flow_entries.send(datapath, self._messages(datapath, action))

    def _messages(self, datapath: Any, action: Action) -> list[Any]:
        match action:
            case Forward(dpid, in_port, frame):
                port = self.mac_table.port_of(dpid, frame[:6])
                return [flow_entries.packet_out(datapath, in_port, port, frame)]
            case OpenPaths():
                messages = path_bundle(action, self._tuning(action), self._xids)
                for message in messages:
                    self._transactions[action.dpid, xid_of(message)] = action.transaction
                return messages
            case ClosePaths(_, session):
                return [flow_entries.delete_paths(datapath, session)]
            case AddBypass(_, five_tuple, session):
                return [flow_entries.bypass(datapath, five_tuple, session, self.bypass_timeout_s)]
            case RemoveBypass(_, five_tuple, session):
                return [flow_entries.delete_bypass(datapath, five_tuple, session)]
            case CountBypass(dpid, five_tuple, session):
                question = flow_entries.count_bypass(datapath, five_tuple, session)
                datapath.set_xid(question)
                self._counting[dpid, question.xid] = five_tuple
                return [question]
            case _:
                raise TypeError(f"{action} is not for a switch")

    def _tuning(self, action: OpenPaths) -> list[Any]:
        datapath = self.datapaths[action.dpid]
        ports = [port for port in action.tuned if port in datapath.ports]
        return [optical_messages.tune(datapath, port, action.frequency_mhz) for port in ports]

    def _note(self, note: Note) -> None:
        fields: dict[str, Any] = {"session": f"{note.session:016x}"} if note.session else {}
        if note.setup_ms is not None:
            fields["setup_ms"] = round(note.setup_ms, 4)
        if note.detail:
            fields["detail"] = note.detail
        if note.after is not None:
            after = {"session": f"{note.after.session:016x}", "ends": note.after.ends}
            fields |= {"ends": note.ends, "after": after}
        if note.asked is not None:
            fields |= request_view(note.asked, self.network)
        session = self.arbiter.sessions.by_number.get(note.session)
        source = note.asked is not None and note.asked.setup.service == Service.PAIR_SOURCE
        if note.event in ("granted", "moved") and session is not None and not source:
            fields["light"] = light_view(session, self.network)
        busy = note.detail.startswith(Reason.BUSY.name)  # so hosts ask again
        if note.event == "refused" and note.at is not None and not busy:
            text = f"session {note.session:016x}: refused, {note.detail}"
            self._port_lines.add(note.at, text, time.monotonic())
        if note.event in ("granted", "moved"):
            self.seals.granted(session)
        if note.event in ("refused", "torn_down"):
            self.idle.over(note.session, self._now())
        if note.event == "torn_down" and note.detail == PREEMPTED:
            self.seals.forget(note.session)
        self.record.write(note.event, **fields, packet_in_count=self.packet_in_count)

    def _drop(self, drop: Drop, at: SwitchPort) -> None:
        self.dropped[drop.cause] += 1
        number, place = self.dropped[drop.cause], f"switch {at.dpid:#x} port {at.port}"
        text = f"dropped ({drop.cause}, {number} so far): {place}: {drop.detail}"
        self._port_lines.add(at, text, time.monotonic())
