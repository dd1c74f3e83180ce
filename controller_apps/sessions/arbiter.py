"""The arbiter of light: segments and switch events in, actions out.

    set-up --> held --last barrier reply--> granted --FIN, RST, silence--> torn down
       |         |`--error, deadline, switch gone, silent node--> refused
       `--> queued for light that others have, if the policy says so

No socket, no clock: `now` is in seconds of one steady clock. TCP repeats what is held and
may add bytes behind it, so a request is known by its connection and sequence number.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

from controller_apps.light.paths import Hop, Network, directions, switches
from controller_apps.light.routing import LightPath
from controller_apps.packets.segments import RST, FiveTuple, parse
from controller_apps.policy.orders import IN_TURN, ORDERS, SLOTS, Queue
from controller_apps.policy.policy import Tap
from controller_apps.policy.schedules import PARALLEL, UNPURIFIED, Purification
from controller_apps.sessions.actions import (
    Action,
    AddBypass,
    CountBypass,
    Drop,
    Forward,
    Note,
)
from controller_apps.sessions.admission import Admission, admit, find_light
from controller_apps.sessions.chains import beside, links_of
from controller_apps.sessions.enquiries import Enquiries
from controller_apps.sessions.given_back import TAKEN_BACK, GivenBack
from controller_apps.sessions.handshakes import WINDOW, Handshakes, is_expected, position
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.ordering import Ordering
from controller_apps.sessions.recovery import Recovery
from controller_apps.sessions.sessions import (
    Arrival,
    Refusal,
    Request,
    Session,
    Sessions,
    new_request,
    read_setup,
)
from controller_apps.sessions.slots import Slots
from controller_apps.sessions.verdicts import Verdicts, released
from controller_apps.timeouts import COUNTING_S, DISCOVERY_S, QUEUE_LOOK_S, SWITCH_GRACE_S
from wire.malformed import MalformedPacket
from wire.metadata.header import METADATA_PORT, session_of
from wire.metadata.setup import SETUP_LENGTH, Setup, refused
from wire.metadata.vocabulary import Handshake, Reason, Service, UnknownService, Verdict
from wire.parameters.network import ControllerSettings

UNOPENED = Drop("unopened", "a set-up message on a connection that its other end has not opened")


@dataclass
class Arbiter:
    """The state of every request, and what to do when something happens."""

    network: Network
    hold_timeout_s: float
    idle_timeout_s: float
    loss_budget_db: float = ControllerSettings().loss_budget_db  # of one light path
    queues: bool = False  # a request for light that is taken waits for it
    sessions: Sessions = field(default_factory=Sessions)
    forbid: Callable[[Setup, FiveTuple], Admission | None] = lambda _setup, _connection: None
    taps: Sequence[Tap] = ()  # for sessions that are still to come
    order: Queue = IN_TURN  # of those that wait for light; see `follow`
    schedule: str = PARALLEL  # for chains that are still to come: one of SCHEDULES
    purification: Purification = UNPURIFIED  # in those
    keys: Mapping[str, str] = field(default_factory=dict)  # device keys, by address of the host
    needs_handshake: bool = False  # on the connection of a set-up; switches tell of them
    discovery_s: float = DISCOVERY_S  # until one that is started again knows the network
    needs_sequence: bool = True  # of a FIN or RST, that fits its connection
    handshakes: Handshakes = field(default_factory=Handshakes)

    def __post_init__(self) -> None:
        self.budget_mdb = round(self.loss_budget_db * 1000)
        self.light = Light(self.network, self.sessions, self.budget_mdb)
        self.verdicts = Verdicts(self.sessions, self.light, self.keys)
        self.ordering = Ordering(self.sessions, self.light, self.verdicts)
        self.given_back = GivenBack(self.sessions)
        self.enquiries = Enquiries(self.sessions)
        self.recovery = Recovery(self.sessions, self.light, self.discovery_s)
        self._looked = -inf  # at all that wait
        self.slots: Slots | None = None
        self.follow(self.order)

    def follow(self, order: Queue) -> None:
        """Let those that come wait in this order; slots that were reserved before are kept."""
        self.order = order
        if order.order != SLOTS:
            self.slots = None
        elif self.slots is None or self.slots.slot_s != order.slot_s:
            self.slots = Slots(self.sessions, order.slot_s)

    def next_slot_s(self, now: float) -> float:
        """Return when there is something to do that must not wait for the next tick."""
        return inf if self.slots is None else self.slots.next_start(now)

    def segment_arrived(self, dpid: int, in_port: int, frame: bytes, now: float) -> list[Action]:
        """Decide on a segment to or from the metadata port that a classical switch sent up."""
        try:
            arrival = Arrival(dpid, in_port, parse(frame))
            return [*self._segment(arrival, now), *self._serve_queue(now)]
        except MalformedPacket as error:
            return [Drop("malformed", str(error))]

    def _segment(self, arrival: Arrival, now: float) -> list[Action]:
        segment = arrival.segment
        if segment.accepts:
            self.handshakes.heard(segment, (arrival.dpid, arrival.in_port))
            return []
        if segment.closes:
            return self._closing(arrival, now)
        if not segment.payload:
            return [Forward(arrival.dpid, arrival.in_port, segment.frame)]
        request = self.sessions.requests.get(segment.five_tuple)
        if request is None:
            if not self._has_begun(arrival, now):
                return [UNOPENED]
            try:
                return self._asked(read_setup(segment.payload), arrival, now)
            except UnknownService:
                return self._unknown(arrival)
        if request.offset(segment.sequence) == 0:
            return self._repeated(request, arrival)
        try:
            setup = read_setup(segment.payload)
        except MalformedPacket:
            return self._data(request, arrival, now)
        # Elsewhere in the sequence space: a new connection between the same ports.
        if not self._has_begun(arrival, now):
            return [UNOPENED]
        return [*self.verdicts.over(request, "port reused", now), *self._asked(setup, arrival, now)]

    def _has_begun(self, arrival: Arrival, now: float) -> bool:
        if not self.needs_handshake or self.recovery.knows_no_handshakes(now):
            return True
        return self.handshakes.completed_by(arrival.segment, (arrival.dpid, arrival.in_port))

    def _unknown(self, arrival: Arrival) -> list[Action]:
        """Refuse a service of another version; the receiver tells the one who asked."""
        message = arrival.segment.payload[:SETUP_LENGTH]
        answer = self.verdicts.sealed(
            refused(message, Reason.UNSUPPORTED), arrival.segment.five_tuple
        )
        frame = arrival.segment.with_payload(answer)
        why = Reason.UNSUPPORTED.name
        note = Note("refused", session_of(message), detail=why, at=arrival.port)
        return [note, Forward(arrival.dpid, arrival.in_port, frame)]

    def _asked(self, setup: Setup, arrival: Arrival, now: float) -> list[Action]:
        if setup.verdict != Verdict.PENDING:
            return [Drop("forged", f"set-up of {setup.session:016x} comes with a verdict")]
        opened = self.needs_handshake and not self.recovery.knows_no_handshakes(now)
        request = new_request(setup, arrival, now, arrival.segment.acknowledged if opened else None)
        if self.sessions.full(request.five_tuple.source):
            return self.verdicts.answer(request, Verdict.REFUSED, Refusal(Reason.BUSY))
        self.sessions.obstacles.clear()
        admission = self.forbid(setup, request.five_tuple) or admit(
            setup, request.five_tuple, self.sessions, self.network, self.budget_mdb, self.taps
        )
        lasts = setup.handshake == Handshake.FRAMED and setup.service != Service.SEAL
        if self.slots and lasts and (admission.paths or admission.waits_for_light):
            return self._reserve(request, now)
        if self.recovery.is_premature(admission.reason, now):
            return [Drop("premature", f"{admission.reason.name} may change soon; TCP repeats it")]
        waits = admission.waits_for_light and self._may_wait(setup, request.five_tuple)
        if admission.reason != Reason.OK and not waits:
            return self.verdicts.refuse(request, admission.refusal, now)
        request.take(admission.block_pairs, admission.wavelength_pm)
        self.sessions.retired.pop(request.five_tuple, None)
        session = self.sessions.join(request, now)
        if waits:
            request.obstacles = frozenset(self.sessions.obstacles)
            return [*self._queue(request), *self._want_back(request, now)]
        if admission.chain:
            plan = self.schedule, self.purification, admission.blocks
            return self.ordering.order(request, session, admission.chain, *plan)
        if not admission.paths:
            return self.verdicts.grant(request)
        return self.light.open(request, session, admission.paths)

    def _reserve(self, request: Request, now: float) -> list[Action]:
        """Let a request wait for a slot of its own, or refuse it if none is free in time."""
        assert self.slots is not None
        self.sessions.retired.pop(request.five_tuple, None)
        self.sessions.join(request, now)
        until = min(request.late, now + self.hold_timeout_s)
        found = self.slots.reserve(request, until, now, self._find_light_beside)
        if not found.paths:
            in_vain = found.reason == Reason.TOO_LATE and request.late == inf
            reason = Reason.BUSY if in_vain else found.reason
            return self.verdicts.refuse(request, found.refusal._replace(reason=reason), now)
        return self._queue(request)

    def _hand_out(self, now: float) -> list[Action]:
        """Take the light of slots that are over, and give that of the slot that has begun."""
        if self.slots is None:
            return []
        actions: list[Action] = []
        for session in self.slots.over(now):
            owner = session.requests[session.owner]
            if owner.held is not None:  # its switches took longer than the slot
                actions += self.verdicts.refuse(owner, Refusal(Reason.TOO_LATE), now)
            else:
                actions += self.verdicts.tear_down(session, "its slot is over", now)
        for request, reserved in self.slots.due(now):
            asking = self.sessions.of(request)
            assert asking is not None  # it waits
            del self.sessions.queue[request.five_tuple]
            request.take(reserved.block_pairs, reserved.wavelength_pm)
            hops = (hop for path in reserved.paths for hop in path.hops)
            if self.network.is_whole(hops) and self.slots.is_free(asking, reserved):
                actions += self._served(request, asking, reserved.paths)
                continue
            found = self._find_light(request)
            if found.paths:
                actions += self._served(request, asking, found.paths)
            else:
                actions += self.verdicts.refuse(request, found.refusal, now)
        return actions

    def _may_wait(self, setup: Setup, connection: FiveTuple) -> bool:
        """Tell whether a request waits for light that others have: as configured, or not for long.

        Who watches a fibre gives its light back soon, and never waits for it: others come first.
        A session that is said to be over is, if the switch has counted as many bytes.
        """
        if setup.service == Service.SEAL:
            return False
        return self.queues or self._soon_free(setup, connection)

    def _soon_free(self, setup: Setup, connection: FiveTuple) -> bool:
        sessions = self.sessions
        ending = {
            number
            for session in sessions.by_number.values()
            if session.setup.service == Service.SEAL or session.doubted
            for number in (session.number, *(link.number for link in links_of(session, sessions)))
        }
        if not ending:
            return False
        others = {way: holder for way, holder in sessions.occupied.items() if holder not in ending}
        without = replace(sessions, occupied=others, obstacles=set())
        words = self.network, self.budget_mdb, self.taps
        return bool(find_light(setup, connection, without, *words).paths)

    def _want_back(self, request: Request, now: float) -> list[Action]:
        """Have the seals end that have light which a request waits for."""
        actions: list[Action] = []
        for seal in self.given_back.in_the_way(request):
            asking = seal.requests[seal.owner]
            if asking.held is not None:  # it has not begun
                actions += self.verdicts.refuse(asking, Refusal(Reason.BUSY, TAKEN_BACK), now)
            else:
                actions += self.given_back.tell(seal, now)
        return actions

    def node_answered(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note what a node of a chain (its address) says to its order."""
        return self.ordering.node_answered(number, node, reason, now)

    def _serve_queue(self, now: float) -> list[Action]:
        """Give light to those that wait for it, if any has become free, in the policy's order.

        A request whose light is still taken keeps no other from light that is free.
        """
        freed, changed = self.sessions.freed, self.sessions.changed
        self.sessions.freed, self.sessions.changed = set(), False
        if self.slots is not None or not self.sessions.queue or not (freed or changed):
            return []
        actions: list[Action] = []
        place = ORDERS[self.order.order]
        for request in sorted(
            self.sessions.queue.values(), key=lambda each: place(each.waiting_for_light)
        ):
            if not changed and freed.isdisjoint(request.obstacles):
                continue  # it would meet them again
            session = self.sessions.of(request)
            if session is None:
                continue  # it has ended meanwhile
            found = self._find_light(request)
            if found.paths:
                del self.sessions.queue[request.five_tuple]
                request.take(found.block_pairs, found.wavelength_pm)
                actions += self._served(request, session, found.paths)
            elif not found.waits_for_light:
                actions += self.verdicts.refuse(request, found.refusal, now)
            else:
                actions += self._want_back(request, now)
        return actions

    def _queue(self, request: Request) -> list[Action]:
        request.queued_at = self.sessions.holders.order
        self.sessions.queue[request.five_tuple] = request
        return [Note("queued", request.setup.session, asked=request)]

    def _served(
        self, request: Request, session: Session, paths: tuple[LightPath, ...]
    ) -> list[Action]:
        """Give light to a request that has waited, and note for whom."""
        ways = directions(hop for path in paths for hop in path.hops)
        asked = session.number, session.frequency_mhz, request.queued_at
        after = self.sessions.holders.last(ways, *asked)
        opening = self.light.open(request, session, paths)
        if after is None:
            return opening
        return [Note("light_after", session.number, ends=session.ends, after=after), *opening]

    def _find_light(self, request: Request) -> Admission:
        self.sessions.obstacles.clear()
        found = self._find_light_beside(request, self.sessions)
        request.obstacles = frozenset(self.sessions.obstacles)
        return found

    def _find_light_beside(self, request: Request, sessions: Sessions) -> Admission:
        connection, budget_mdb = request.five_tuple, self.budget_mdb
        return find_light(request.setup, connection, sessions, self.network, budget_mdb, self.taps)

    def _repeated(self, request: Request, arrival: Arrival) -> list[Action]:
        message = arrival.segment.payload[:SETUP_LENGTH]
        if message not in (request.message, request.answer):
            return [Drop("forged", "another set-up message under the same sequence number")]
        if request.held is not None:
            return [Drop("repeated", "the set-up message is held already")]
        # The answer also comes by when a second switch is on the way.
        return [released(request, arrival)]

    def _data(self, request: Request, arrival: Arrival, now: float) -> list[Action]:
        offset = request.offset(arrival.segment.sequence)
        if request.held is not None or offset < SETUP_LENGTH:
            return [Drop("early", "data before the set-up message was answered")]
        if offset <= request.progress + WINDOW:
            request.heard(arrival.segment)
        forward = Forward(arrival.dpid, arrival.in_port, arrival.segment.frame)
        session = self.sessions.of(request)
        if session is None:
            return [forward]
        session.heard(now)
        if not request.lasts or arrival.dpid in request.bypassed:
            return [forward]
        # Not earlier: until data follows, a repeated set-up message must still come by.
        request.bypassed.add(arrival.dpid)
        return [AddBypass(arrival.dpid, request.five_tuple, session.number), forward]

    def _closing(self, arrival: Arrival, now: float) -> list[Action]:
        segment = arrival.segment
        from_opener = segment.five_tuple.destination_port == METADATA_PORT
        opener = segment.five_tuple if from_opener else segment.five_tuple.reverse()
        request = self.sessions.requests.get(opener)
        if request is None:
            return []
        if not self.needs_sequence or is_expected(request, segment, from_opener):
            return self.verdicts.over(request, "RST" if segment.flags & RST else "FIN", now)
        at = position(request, segment, from_opener)
        if request.bypassed and request.doubted is None and at is not None and at >= 0:
            request.doubted = at, now
            return self._count(request)
        return []  # an earlier connection between the same ports, or a guess of somebody else

    def bypass_counted(self, five_tuple: FiveTuple, count: int, now: float) -> list[Action]:
        """Believe a close after all if so many bytes, headers included, have gone that far.

        What the switch has counted lags behind; who may be wrong is asked again COUNTING_S later.
        """
        request = self.sessions.requests.get(five_tuple)
        if request is None or request.doubted is None:
            return []
        at, since = request.doubted
        if at <= request.progress + count + WINDOW:
            request.doubted = None
            return [*self.verdicts.over(request, "close", now), *self._serve_queue(now)]
        if now - since >= COUNTING_S:
            request.doubted = None  # a guess
        return []

    def _count_doubted(self, now: float) -> list[Action]:
        return [
            action
            for session in self.sessions.by_number.values()
            for request in session.requests.values()
            if request.doubted is not None and now - request.doubted[1] >= COUNTING_S
            for action in self._count(request)
        ]

    def _count(self, request: Request) -> list[Action]:
        dpids = sorted(request.bypassed)[:1]
        return [CountBypass(dpid, request.five_tuple, request.setup.session) for dpid in dpids]

    def barrier_passed(self, dpid: int, transaction: int, now: float) -> list[Action]:
        """Note that a switch has set up its part; release the message after the last one."""
        request = self.sessions.held.get(transaction)
        if request is None:
            return self.light.barrier_passed(dpid, transaction, now)
        request.waiting.discard(dpid)
        if request.waiting:
            return []
        elapsed_ms = (now - request.started) * 1000
        granted = self.verdicts.grant(
            request, Note("path_ready", request.setup.session, elapsed_ms)
        )
        # A fibre may have been cut meanwhile.
        session = self.sessions.of(request)
        assert session is not None
        return [*granted, *self._mend(session, now)]

    def switch_refused(self, transaction: int, now: float) -> list[Action]:
        """Refuse what a switch has answered with an error; end a session it cannot move."""
        request = self.sessions.held.get(transaction)
        move = self.light.moves.get(transaction)
        actions: list[Action] = []
        if request is not None:
            session = self.sessions.of(request)
            assert session is not None
            self.light.doubt_tuning(session)
            actions = self.verdicts.refuse(request, Refusal(Reason.SWITCH_FAILED), now)
        elif move is not None:
            session = self.sessions.by_number[move.session]
            self.light.doubt_tuning(session)
            actions = self.verdicts.tear_down(session, "the switch refused the other way", now)
        return [*actions, *self._serve_queue(now)]

    def network_changed(self, now: float) -> list[Action]:
        """Move the sessions whose fibres are cut, and serve those that wait for light."""
        self.sessions.changed = True
        actions: list[Action] = []
        for session in self.sessions.by_number.values():
            actions += self._mend(session, now)
        return [*actions, *self._serve_queue(now)]

    def switch_left(self, dpid: int, now: float) -> list[Action]:
        """Move what depends on a switch that is gone; without another way it has some time."""
        self.network.connected.discard(dpid)
        self.sessions.changed = True  # those that wait are told, too
        self.light.switch_left(dpid)
        for request in self.sessions.requests.values():
            request.bypassed.discard(dpid)
        actions: list[Action] = []
        for session in list(self.sessions.by_number.values()):
            if dpid in switches(session.hops):
                actions += self._dropped_by_switch(session, now)
        return [*actions, *self._serve_queue(now)]

    def _dropped_by_switch(self, session: Session, now: float) -> list[Action]:
        request = self._holds_light(session)
        if request.held is not None:
            return self.verdicts.refuse(request, Refusal(Reason.SWITCH_FAILED), now)
        moved = self.light.move(session, now)
        if moved is None:
            session.lost_since = now  # its bridge keeps the paths; it may be back soon
        return moved or []

    def _mend(self, session: Session, now: float) -> list[Action]:
        if self.network.connected.issuperset(switches(session.hops)):
            session.lost_since = None
        elif session.resumed is not None:
            return []  # its switches have yet to find this controller
        if not self.light.is_broken(session):
            session.stranded = False
            return []
        if self._holds_light(session).held is not None:
            return []  # not before it is granted
        moved = self.light.move(session, now)
        return self.light.strand(session) if moved is None else moved

    def _holds_light(self, session: Session) -> Request:
        assert session.light_owner is not None
        return session.requests[session.light_owner]

    def is_live(self, session: int) -> bool:
        return session in self.sessions.by_number and bool(self.sessions.by_number[session].paths)

    def entries_found(self, dpid: int, entries: Iterable[tuple[int, Hop | None]]) -> list[Action]:
        """Make what a switch has kept (session and hop of each entry) what it shall have."""
        return self.light.entries_found(dpid, entries)

    def resume(self, session: Session, now: float) -> None:
        """Take over what another controller has kept; raise MalformedPacket if that cannot be."""
        self.recovery.resume(session, now)
        self.enquiries.begin(session, now)
        for request in session.requests.values():
            self.verdicts.seal(request)

    def session_told(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note what a host (its address) says of a session; end one that ended unseen."""
        over = self.enquiries.told(number, node, reason)
        if over is None:
            return []
        ended = self.verdicts.tear_down(over, "ended while no controller was there", now)
        return [*ended, *self._serve_queue(now)]

    def bypasses_found(self, dpid: int, entries: Iterable[tuple[int, FiveTuple]]) -> list[Action]:
        """Take what a classical switch lets pass (session and connection of each entry)."""
        return self.recovery.bypasses_found(dpid, entries)

    def bypass_expired(self, dpid: int, five_tuple: FiveTuple, now: float) -> list[Action]:
        """Note that a connection has been silent; end its session if all of it has been."""
        request = self.sessions.requests.get(five_tuple)
        if request is not None:
            request.bypassed.discard(dpid)
        return self.tick(now)

    def tick(self, now: float) -> list[Action]:
        """Do what is due: refuse what waited too long, end sessions that fell silent."""
        actions: list[Action] = []
        for request in list(self.sessions.held.values()):
            if request.unanswered:
                actions += self.ordering.give_up(request, now)
            elif now - request.started >= self.hold_timeout_s:
                actions += self.verdicts.refuse(request, Refusal(Reason.SWITCH_TIMEOUT), now)
        for request in list(self.sessions.queue.values()):
            if now >= request.late:
                actions += self.verdicts.refuse(request, Refusal(Reason.TOO_LATE), now)
            elif now - request.started >= self.hold_timeout_s:
                actions += self.verdicts.refuse(request, Refusal(Reason.BUSY), now)
        actions += self._hand_out(now)
        for seal in self.given_back.late(now):
            actions += self.verdicts.tear_down(seal, TAKEN_BACK, now)
        for session in self.light.overdue(now - self.hold_timeout_s):
            actions += self.verdicts.tear_down(session, "no switch in time for the other way", now)
        for session in list(self.sessions.by_number.values()):
            if session.number not in self.sessions.by_number:
                continue  # a link whose chain has just ended
            if session.lost_since is not None and now - session.lost_since >= SWITCH_GRACE_S:
                actions += self.verdicts.tear_down(session, "switch gone", now)
                continue
            if session.resumed is not None and now - session.resumed < SWITCH_GRACE_S:
                continue  # a switch may yet tell that it is alive
            session.resumed = None
            if not session.confirmed:
                actions += self.verdicts.tear_down(session, "no switch has kept it", now)
                continue
            silent = now - session.seen >= self.idle_timeout_s
            silent = silent and not links_of(session, self.sessions)  # its traffic is theirs
            # A link waits until all of its chain stands, which takes a while if it is long.
            links = beside(session, self.sessions) if silent else ()
            silent = silent and all(now - link.seen >= self.idle_timeout_s for link in links)
            if silent and session.open and not session.bypassed:
                actions += self.verdicts.tear_down(session, "idle", now)
        self.sessions.forget_retired_before(now - self.idle_timeout_s)
        if now - self._looked >= QUEUE_LOOK_S:  # losses and tunings change, too
            self._looked, self.sessions.changed = now, True
        counting = self._count_doubted(now)
        asking = self.enquiries.due(now)
        return [*actions, *counting, *asking, *self.recovery.restored(), *self._serve_queue(now)]
