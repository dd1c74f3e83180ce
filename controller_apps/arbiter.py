"""Who gets light when: segments and switch events in, actions out.

    set-up --> held --last barrier reply--> granted --FIN, RST, silence--> torn down
                 `--error, deadline, switch gone--> refused

No socket, no clock: `now` is in seconds of one steady clock. TCP repeats what is held and
may add bytes behind it, so a request is known by its connection and sequence number.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import reduce
from itertools import count
from operator import xor

from controller_apps.actions import (
    Action,
    AddBypass,
    ClosePaths,
    Drop,
    Forward,
    Note,
    OpenPaths,
    RemoveBypass,
)
from controller_apps.admission import Admission, admit
from controller_apps.paths import Hop, Network, switches
from controller_apps.segments import RST, FiveTuple, parse
from controller_apps.sessions import Arrival, Request, Session, Sessions, new_request, read_setup
from wire.metadata import METADATA_PORT, SETUP_LENGTH, MalformedPacket, Reason, Setup, Verdict


@dataclass
class Arbiter:
    """The state of every request, and what to do when something happens."""

    network: Network
    rotations: dict[int, int]  # known rotation of each switch, by datapath id
    hold_timeout_s: float
    idle_timeout_s: float
    sessions: Sessions = field(default_factory=Sessions)
    forbid: Callable[[Setup, FiveTuple], Admission | None] = lambda _setup, _connection: None
    _transactions: Iterator[int] = field(default_factory=lambda: count(1))

    def segment_arrived(self, dpid: int, in_port: int, frame: bytes, now: float) -> list[Action]:
        """Decide on a segment to or from the metadata port that a classical switch sent up."""
        try:
            arrival = Arrival(dpid, in_port, parse(frame))
            return self._segment(arrival, now)
        except MalformedPacket as error:
            return [Drop("malformed", str(error))]

    def _segment(self, arrival: Arrival, now: float) -> list[Action]:
        segment = arrival.segment
        if segment.closes:
            return self._closing(arrival, now)
        if not segment.payload:
            return [Forward(arrival.dpid, arrival.in_port, segment.frame)]
        request = self.sessions.requests.get(segment.five_tuple)
        if request is None:
            return self._asked(read_setup(segment.payload), arrival, now)
        if request.offset(segment) == 0:
            return self._repeated(request, arrival)
        try:
            setup = read_setup(segment.payload)
        except MalformedPacket:
            return self._data(request, arrival, now)
        # Elsewhere in the sequence space: a new connection between the same ports.
        return [*self._over(request, "port reused", now), *self._asked(setup, arrival, now)]

    def _asked(self, setup: Setup, arrival: Arrival, now: float) -> list[Action]:
        if setup.verdict != Verdict.PENDING:
            return [Drop("forged", f"set-up of {setup.session:016x} comes with a verdict")]
        request = new_request(setup, arrival, now)
        if self.sessions.full:
            return self._answer(request, Verdict.REFUSED, Reason.BUSY)
        admission = self.forbid(setup, request.five_tuple) or admit(
            setup, request.five_tuple, self.sessions, self.network
        )
        if admission.reason != Reason.OK:
            return self._refuse(request, admission.reason, now)
        self.sessions.retired.pop(request.five_tuple, None)
        session = self.sessions.join(request, now)
        if not admission.hops:
            return self._grant(request)
        return self._open(request, session, admission.hops)

    def _open(self, request: Request, session: Session, hops: tuple[Hop, ...]) -> list[Action]:
        # An earlier connection of the session may still keep its path: it is handed over.
        stale = self._darken(session) if session.hops != hops else []
        self.sessions.occupy(session, hops, request.five_tuple)
        request.transaction = next(self._transactions)
        request.waiting = set(switches(hops))
        request.rotation = reduce(xor, (self.rotations.get(hop.dpid, 0) for hop in hops))
        self.sessions.held[request.transaction] = request
        bundles = [
            OpenPaths(
                dpid,
                tuple(hop for hop in hops if hop.dpid == dpid),
                session.number,
                request.transaction,
            )
            for dpid in switches(hops)
        ]
        return [*stale, *bundles]

    def _repeated(self, request: Request, arrival: Arrival) -> list[Action]:
        message = arrival.segment.payload[:SETUP_LENGTH]
        if message not in (request.message, request.answer):
            return [Drop("forged", "another set-up message under the same sequence number")]
        if request.held is not None:
            return [Drop("repeated", "the set-up message is held already")]
        # The answer also comes by when a second switch is on the way.
        return [_released(request, arrival)]

    def _data(self, request: Request, arrival: Arrival, now: float) -> list[Action]:
        if request.held is not None or request.offset(arrival.segment) < SETUP_LENGTH:
            return [Drop("early", "data before the set-up message was answered")]
        forward = Forward(arrival.dpid, arrival.in_port, arrival.segment.frame)
        session = self.sessions.of(request)
        if session is None:
            return [forward]
        session.seen = now
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
        if request is None or (from_opener and request.offset(segment) < 0):
            return []  # never ours, or an earlier connection between the same ports
        return self._over(request, "RST" if segment.flags & RST else "FIN", now)

    def barrier_passed(self, dpid: int, transaction: int, now: float) -> list[Action]:
        """Note that a switch has set up its part; release the message after the last one."""
        request = self.sessions.held.get(transaction)
        if request is None:
            return []
        request.waiting.discard(dpid)
        if request.waiting:
            return []
        elapsed_ms = (now - request.started) * 1000
        return self._grant(request, Note("path_ready", request.setup.session, elapsed_ms))

    def switch_refused(self, transaction: int, now: float) -> list[Action]:
        """Refuse what a switch has answered with an error."""
        request = self.sessions.held.get(transaction)
        return [] if request is None else self._refuse(request, Reason.SWITCH_FAILED, now)

    def switch_left(self, dpid: int, now: float) -> list[Action]:
        """End what depends on a switch that is gone."""
        self.network.connected.discard(dpid)
        for request in self.sessions.requests.values():
            request.bypassed.discard(dpid)
        actions: list[Action] = []
        for session in list(self.sessions.by_number.values()):
            if dpid in switches(session.hops):
                actions += self._dropped_by_switch(session, now)
        return actions

    def _dropped_by_switch(self, session: Session, now: float) -> list[Action]:
        assert session.light_owner is not None
        request = session.requests[session.light_owner]
        if request.held is not None:
            return self._refuse(request, Reason.SWITCH_FAILED, now)
        return [*self._end(session, now), Note("torn_down", session.number, detail="switch gone")]

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
            if now - request.started >= self.hold_timeout_s:
                actions += self._refuse(request, Reason.SWITCH_TIMEOUT, now)
        for session in list(self.sessions.by_number.values()):
            silent = now - session.seen >= self.idle_timeout_s
            if silent and session.open and not session.bypassed:
                note = Note("torn_down", session.number, detail="idle")
                actions += [*self._end(session, now), note]
        self.sessions.forget_retired_before(now - self.idle_timeout_s)
        return actions

    def is_live(self, session: int) -> bool:
        """Tell whether a session has light."""
        return session in self.sessions.by_number and bool(self.sessions.by_number[session].hops)

    def _grant(self, request: Request, *notes: Note) -> list[Action]:
        session = self.sessions.of(request)
        assert session is not None
        session.open = True
        answer = self._answer(request, Verdict.GRANTED, Reason.OK)
        return [*answer, *notes, Note("granted", session.number)]

    def _refuse(self, request: Request, reason: Reason, now: float) -> list[Action]:
        undone = self._leave(request, now)
        note = Note("refused", request.setup.session, detail=reason.name)
        return [*undone, *self._answer(request, Verdict.REFUSED, reason), note]

    def _answer(self, request: Request, verdict: Verdict, reason: Reason) -> list[Action]:
        self.sessions.held.pop(request.transaction, None)
        arrival = request.decide(verdict, reason)
        return [_released(request, arrival)]

    def _over(self, request: Request, cause: str, now: float) -> list[Action]:
        if request.held is not None:
            # It must pass all the same, or TCP would repeat it for minutes.
            return self._refuse(request, Reason.PROTOCOL, now)
        had_session = self.sessions.of(request) is not None
        undone = self._leave(request, now)
        note = Note("torn_down", request.setup.session, detail=cause)
        return [*undone, note] if had_session else undone

    def _leave(self, request: Request, now: float) -> list[Action]:
        """Take a request out of its session, which ends with the connection that owns it."""
        session = self.sessions.of(request)
        actions: list[Action] = []
        if session is not None and session.owner == request.five_tuple:
            actions = self._end(session, now)
        elif session is not None:
            session.seen = now
            actions = self._punt_again(request)
            if session.light_owner == request.five_tuple:
                actions += self._darken(session)
        self.sessions.retire(request, now)
        return actions

    def _end(self, session: Session, now: float) -> list[Action]:
        actions = self._darken(session)
        members = list(session.requests.values())
        del self.sessions.by_number[session.number]
        for request in members:
            actions += self._punt_again(request)
            if request.held is not None and request.five_tuple != session.owner:
                actions += self._answer(request, Verdict.REFUSED, Reason.UNKNOWN_SESSION)
            self.sessions.retire(request, now)
        return actions

    def _darken(self, session: Session) -> list[Action]:
        dark: list[Action] = [ClosePaths(dpid, session.number) for dpid in switches(session.hops)]
        self.sessions.vacate(session)
        return dark

    def _punt_again(self, request: Request) -> list[Action]:
        removals: list[Action] = [
            RemoveBypass(dpid, request.five_tuple, request.setup.session)
            for dpid in sorted(request.bypassed)
        ]
        request.bypassed.clear()
        return removals


def _released(request: Request, arrival: Arrival) -> Forward:
    """Return the answer in the clothes of the segment; TCP repeats what came behind it."""
    frame = arrival.segment.with_payload(request.answer)
    return Forward(arrival.dpid, arrival.in_port, frame)
