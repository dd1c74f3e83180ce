"""The arbiter of light: segments and switch events in, actions out. No socket, no clock.

How it decides
--------------

Hosts ask for light over TCP. The opener of a session sends a *set-up* message to the metadata port
of the acceptor; classical switches send the first segments of such connections to the controller
instead of to the acceptor. The arbiter *holds* the message, decides, writes its verdict into it,
and only then passes it on: a host that receives a granted set-up knows that the light path stands.

    set-up --> held --last barrier reply--> granted --FIN, RST, silence--> torn down
       |         |`--error, deadline, switch gone--> refused
       `--> queued for light that others have, if the policy says so

**A segment.** TCP may repeat a message and add bytes behind it, so a request is known by its
connection and sequence number (`_segment`). A SYN ACK is noted (`handshakes`): a set-up counts only
on a connection that both ends have opened. A new set-up goes to `setups`. Copies, data, FIN and RST
of a known connection go to `connections`.

**A set-up** is dropped if it is forged or comes too early after a restart; refused if the policy
forbids it or `admission` finds no light for it (admission changes nothing); queued if others have
the light and it may wait; else opened. Light that is given at once is programmed by `light_paths`,
one transaction for all switches, and the request is held until each has answered its barrier.

**Waiting.** `light_queue` serves requests in the policy's order each time that light becomes free;
one that still has to wait keeps no other from light. With slots (`slots`) a request has the
light of a reserved slot. Link monitors only borrow light: they never wait, and give it back
(`preempted`).

**Faults.** If a fibre is cut or a switch is gone, `repairs` moves a session to a path of the same
rotation, which the receiver knows from the set-up. Without such a path it is stranded until its
own is whole again. A switch that is gone has 10 s to return.

**Ends.** A session lives as long as the connection that opened it. After the first data a bypass
lets a connection pass the switch directly; the switch then reports its silence. `expiry` refuses
and tears down what has waited or been silent too long. `verdicts` does both: it takes light,
bypasses and returns with the session, and answers what is still held.

**Another controller** finds sessions in a state folder. They are in doubt until a switch confirms
them (`recovery`) or a host does (`enquiries`); nothing is opened for them before.

Each event ends with a look at the queue, because any of them may have freed light.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Hop, Network
from controller_apps.packets import FiveTuple, parse_segment
from controller_apps.policy.policy import Policy
from controller_apps.policy.schedules import IN_TURN, Queue
from controller_apps.sessions.actions import Action, Drop, Forward, Note
from controller_apps.sessions.connections import Connections, Handshakes
from controller_apps.sessions.copies import Copies
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.light_queue import LightQueue
from controller_apps.sessions.link_monitors import Preempted
from controller_apps.sessions.recovery import Enquiries, Recovery
from controller_apps.sessions.repairs import Expiry, Repairs
from controller_apps.sessions.sessions import Arrival, Session, Sessions, read_setup
from controller_apps.sessions.setups import Setups
from controller_apps.sessions.slots import SlotGrants
from controller_apps.sessions.switch_chains import emissions
from controller_apps.sessions.terms import UNFILTERED, Terms
from controller_apps.sessions.verdicts import Verdicts
from controller_apps.timeouts import DISCOVERY_S
from wire.analyser_frames import WITH_OUTCOMES, AnalyserFrame, End, Receivers, group_of
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import Reason
from wire.parameters.network import ControllerSettings


@dataclass
class Arbiter:
    """Passes each event to the part that decides on it. `now`: seconds of one steady clock."""

    network: Network
    hold_timeout_s: float
    idle_timeout_s: float
    loss_budget_db: float = ControllerSettings().loss_budget_db  # of one light path
    queues: bool = False  # a request for light that is taken waits for it
    needs_copies: bool = False  # light waits until its switches have seen the set-up themselves
    order: Queue = IN_TURN  # of the policy until `follow`
    keys: Mapping[str, str] = field(default_factory=dict)  # device keys, by address of the host
    discovery_s: float = DISCOVERY_S  # until a restarted controller knows the network
    sessions: Sessions = field(default_factory=Sessions)

    def __post_init__(self) -> None:
        budget_mdb = round(self.loss_budget_db * 1000)
        network, sessions = self.network, self.sessions
        terms = self.terms = Terms(
            network, self.hold_timeout_s, self.idle_timeout_s, budget_mdb, self.queues
        )
        light = self.light = Light(network, sessions, budget_mdb, self.needs_copies)
        verdicts = self.verdicts = Verdicts(sessions, light, terms, self.keys)
        self.handshakes, self.copies = Handshakes(), Copies(sessions, light)
        self.recovery = Recovery(sessions, light, self.discovery_s)
        self.enquiries = Enquiries(sessions)
        preempted = Preempted(sessions)
        self.queue = LightQueue(sessions, terms, light, verdicts, preempted)
        self.grants = SlotGrants(sessions, network, self.queue, verdicts)
        self.setups = Setups(
            sessions=sessions,
            terms=terms,
            light=light,
            verdicts=verdicts,
            handshakes=self.handshakes,
            copies=self.copies,
            recovery=self.recovery,
            queue=self.queue,
            grants=self.grants,
        )
        self.connections = Connections(sessions, terms, verdicts)
        self.repairs = Repairs(network, sessions, light, verdicts)
        self.expiry = Expiry(sessions, terms, light, verdicts, preempted)
        self.follow(replace(UNFILTERED, queue=self.order))

    def follow(self, policy: Policy) -> None:
        self.terms.policy = policy
        self.grants.follow(policy.queue)

    def next_slot_s(self, now: float) -> float:
        """Return when there is something to do that must not wait for the next tick."""
        ends = (each.started + self.hold_timeout_s for each in self.sessions.held.values())
        return min([self.grants.next_start(now), *islice(ends, 1)])  # the first has waited longest

    @property
    def holds(self) -> bool:
        """Whether messages wait for switches."""
        return bool(self.sessions.held)

    def segment_arrived(self, dpid: int, in_port: int, frame: bytes, now: float) -> list[Action]:
        try:
            arrival = Arrival(dpid, in_port, parse_segment(frame))
            return self._then_serve(self._segment(arrival, now), now)
        except MalformedPacket as error:
            return [Drop("malformed", str(error), SwitchPort(dpid, in_port))]

    def copy_arrived(self, at: SwitchPort, frame: bytes, now: float) -> list[Action]:
        """Note a set-up message that a quantum switch has got itself."""
        try:
            return self.copies.arrived(at, frame, now)
        except MalformedPacket as error:
            return [Drop("malformed", str(error), at)]

    def inner_frame(self, at: SwitchPort, number: int, data: bytes) -> list[Action]:
        """Take a frame of an inner port, by the number of its session: herald, or outcomes."""
        session = self.sessions.by_number.get(number)
        if session is None or not session.open:
            return []
        try:
            frame = AnalyserFrame.decode(data)
        except MalformedPacket as error:
            return [Drop("inner frame", str(error), at)]
        actions: list[Action] = []
        if frame.end in (End.STORED, End.WAITS):
            actions += emissions(session, at, frame)
        if session.turns is not None and frame.end in WITH_OUTCOMES:
            actions += self.light.release(session, session.turns.arrived(at, frame))
        return actions

    def host_frame(self, at: SwitchPort, data: bytes) -> list[Action]:
        """Take what a host of a session has measured of pairs that are purified."""
        try:
            frame = AnalyserFrame.decode(data)
        except MalformedPacket as error:
            return [Drop("inner frame", str(error), at)]
        for session in self.sessions.by_number.values():
            turns, group = session.turns, group_of(session.number, Receivers.CONTROLLER)
            if turns is not None and session.open and data[:6] == group:
                for end, address in turns.hosts.addresses.items():
                    if (frame.port, frame.end, data[6:12]) == (end, End.PURIFIED, address):
                        return self.light.release(session, turns.arrived(end, frame))
        return [Drop("inner frame", f"{data[6:12].hex(':')} is not an end of a session", at)]

    def _segment(self, arrival: Arrival, now: float) -> list[Action]:
        segment = arrival.segment
        if segment.accepts:
            self.handshakes.heard(segment, (arrival.dpid, arrival.in_port))
            return []
        if segment.closes:
            return self.connections.closed(segment, now)
        if not segment.payload:
            return [Forward(arrival.dpid, arrival.in_port, segment.frame)]
        request = self.sessions.requests.get(segment.five_tuple)
        if request is None:
            return self.setups.arrived(arrival, now)
        if request.offset(segment.sequence) == 0:
            return self.connections.repeated(request, arrival)
        try:
            setup = read_setup(segment.payload)
        except MalformedPacket:
            return self.connections.data(request, arrival, now)
        # Elsewhere in the sequence space: a new connection between the same ports.
        return self.setups.reopened(setup, arrival, request, now)

    def _then_serve(self, actions: list[Action], now: float) -> list[Action]:
        if self.grants.slots is not None:  # which have light of their own
            self.sessions.freed, self.sessions.changed = set(), False
            return actions
        return [*actions, *self.queue.serve(now)]

    def barrier_passed(self, dpid: int, transaction: int, now: float) -> list[Action]:
        """Note that a switch has set up its part; release the message after the last one."""
        request = self.sessions.held.get(transaction)
        if request is None:
            return self.light.barrier_passed(dpid, transaction, now)
        request.waiting.discard(dpid)
        if request.waiting:
            return []
        setup_ms = (now - request.started) * 1000
        granted = self.verdicts.grant(request, Note("path_ready", request.setup.session, setup_ms))
        session = self.sessions.of(request)
        assert session is not None
        # A fibre may have been cut meanwhile.
        return [*granted, *self.repairs.mend(session, now)]

    def switch_refused(self, transaction: int, now: float) -> list[Action]:
        return self._then_serve(self.repairs.switch_refused(transaction, now), now)

    def network_changed(self, now: float) -> list[Action]:
        return self._then_serve(self.repairs.network_changed(now), now)

    def switch_left(self, dpid: int, now: float) -> list[Action]:
        return self._then_serve(self.repairs.switch_left(dpid, now), now)

    def entries_found(self, dpid: int, entries: Iterable[tuple[int, Hop | None]]) -> list[Action]:
        """Compare the entries of a switch (session and hop of each) with the paths of sessions."""
        return self.light.entries_found(dpid, entries)

    def bypasses_found(self, dpid: int, entries: Iterable[tuple[int, FiveTuple]]) -> list[Action]:
        """Note the bypasses of a classical switch (session and connection of each)."""
        return self.recovery.bypasses_found(dpid, entries)

    def bypass_counted(self, five_tuple: FiveTuple, count: int, now: float) -> list[Action]:
        """Note how many bytes of a connection have passed a bypass."""
        return self._then_serve(self.connections.counted(five_tuple, count, now), now)

    def bypass_expired(self, dpid: int, five_tuple: FiveTuple, now: float) -> list[Action]:
        """Note that a connection has been silent; end its session if all of it has been."""
        request = self.sessions.requests.get(five_tuple)
        if request is not None:
            request.bypassed.discard(dpid)
        return self.tick(now)

    def resume(self, session: Session, now: float) -> None:
        """Take over a session of another controller; raise MalformedPacket if that cannot be."""
        self.recovery.resume(session, now)
        self.enquiries.begin(session, now)
        for request in session.requests.values():
            self.verdicts.seal(request)

    def session_reported(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note a host's (its address) report on a session; end one that ended unseen."""
        session = self.enquiries.reported(number, node, reason)
        if session is None:
            return []
        cause = "ended while no controller was there"
        return self._then_serve(self.verdicts.tear_down(session, cause, now), now)

    def tick(self, now: float) -> list[Action]:
        """Do what is due: a deadline, a slot, a question."""
        actions = [
            *self.expiry.refuse_held(now),
            *self.queue.expire(now),
            *self.grants.hand_over(now),
            *self.expiry.tear_down(now),
        ]
        self.sessions.forget_retired_before(now - self.idle_timeout_s)
        self.queue.look_again(now)
        actions += self.connections.count_again(now)
        actions += self.enquiries.due(now)
        actions += self.recovery.restored()
        return self._then_serve(actions, now)
