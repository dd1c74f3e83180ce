"""The decision on a set-up message: drop it, refuse it, queue it, or open its light.

A request for a chain of repeaters waits until every node has answered its order.

set-up --> ordered --last answer--> granted
              `--refusal, silence--> refused, with the address of that node
"""

from dataclasses import dataclass

from controller_apps.policy.schedules import PARALLEL, Purification
from controller_apps.sessions.actions import Action, Drop, Forward, Note, SwapsOrdered
from controller_apps.sessions.admission import Admission, admit
from controller_apps.sessions.connections import Handshakes
from controller_apps.sessions.copies import Copies
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.light_queue import LightQueue
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
from controller_apps.sessions.slots import SlotGrants
from controller_apps.sessions.swap_turns import Hosts, are_stored, swap_turns
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts
from controller_apps.timeouts import NODE_TIMEOUT_S
from wire.analyser_frames import Receivers
from wire.metadata.header import session_of
from wire.metadata.setup import SETUP_LENGTH, Setup, refused
from wire.metadata.vocabulary import (
    Handshake,
    MemoryState,
    Reason,
    Service,
    UnknownService,
    Verdict,
)
from wire.services import MONITORS


@dataclass
class Ordering:
    """Acts on the sessions that have chains."""

    sessions: Sessions
    light: Light
    verdicts: Verdicts

    def order(
        self,
        request: Request,
        session: Session,
        admission: Admission,
        schedule: str,
        purification: Purification,
    ) -> list[Action]:
        """Send their orders to the nodes of a chain; the request waits for their answers."""
        session.chain = admission.chain
        request.unanswered = {stop.address for stop in admission.chain}
        self.light.hold(request)
        return [
            SwapsOrdered(session.number, admission.chain, schedule, purification, admission.blocks)
        ]

    def node_answered(self, number: int, node: str, reason: Reason, now: float) -> list[Action]:
        """Note the answer of a node (its address); grant the request after the last."""
        session = self.sessions.by_number.get(number)
        request = session.requests.get(session.owner) if session is not None else None
        if request is None or node not in request.unanswered:
            return []
        if reason != Reason.OK:
            return self.verdicts.refuse(request, Refusal(reason, node, node), now)
        request.unanswered.discard(node)
        if request.unanswered:
            return []
        elapsed_ms = (now - request.started) * 1000
        return self.verdicts.grant(request, Note("chain_ready", number, elapsed_ms))

    def give_up(self, request: Request, now: float) -> list[Action]:
        """Refuse a request for which a node has been silent for too long."""
        session = self.sessions.of(request)
        if session is None or now - request.started < NODE_TIMEOUT_S:
            return []
        nodes = (stop.address for stop in session.chain)
        silent = next(node for node in nodes if node in request.unanswered)
        return self.verdicts.refuse(request, Refusal(Reason.NODE_SILENT, silent, silent), now)


TURNS = "hosts take turns only where they purify"
TURNS_OF_HOSTS = Admission(Reason.NO_CHAIN, detail=TURNS, obstacle=TURNS)
STORED = "switches purify only light that their memories take in"
UNSTORED = Admission(Reason.NO_CHAIN, detail=STORED, obstacle=STORED)
UNOPENED = "a set-up message on a connection that its other end has not opened"


@dataclass
class Setups:
    """Decides on the set-up messages of new connections."""

    sessions: Sessions
    terms: Terms
    light: Light
    verdicts: Verdicts
    handshakes: Handshakes
    copies: Copies
    recovery: Recovery
    ordering: Ordering
    queue: LightQueue
    grants: SlotGrants

    def arrived(self, arrival: Arrival, now: float) -> list[Action]:
        """Decide on the first data of a connection; raise MalformedPacket if it is no set-up."""
        if not self._is_opened(arrival, now):
            return [Drop("unopened", UNOPENED, arrival.port)]
        try:
            setup = read_setup(arrival.segment.payload)
        except UnknownService:
            return self._refuse_unknown(arrival)
        return self.decide(setup, arrival, now)

    def reopened(self, setup: Setup, arrival: Arrival, before: Request, now: float) -> list[Action]:
        if not self._is_opened(arrival, now):
            return [Drop("unopened", UNOPENED, arrival.port)]
        return [
            *self.verdicts.over(before, "port reused", now),
            *self.decide(setup, arrival, now),
        ]

    def _needs_handshake(self, now: float) -> bool:
        return self.terms.policy.filter.handshakes and not self.recovery.knows_no_handshakes(now)

    def _is_opened(self, arrival: Arrival, now: float) -> bool:
        at = arrival.dpid, arrival.in_port
        return not self._needs_handshake(now) or self.handshakes.completed_by(arrival.segment, at)

    def _refuse_unknown(self, arrival: Arrival) -> list[Action]:
        """Refuse a service of another version; the receiver reports it to the opener."""
        message = arrival.segment.payload[:SETUP_LENGTH]
        refusal = refused(message, Reason.UNSUPPORTED)
        answer = self.verdicts.sealed(refusal, arrival.segment.five_tuple)
        frame = arrival.segment.with_payload(answer)
        detail = Reason.UNSUPPORTED.name
        note = Note("refused", session_of(message), detail=detail, at=arrival.port)
        return [note, Forward(arrival.dpid, arrival.in_port, frame)]

    def decide(self, setup: Setup, arrival: Arrival, now: float) -> list[Action]:
        if setup.verdict != Verdict.PENDING:
            detail = f"set-up of {setup.session:016x} comes with a verdict"
            return [Drop("forged", detail, arrival.port)]
        acceptor_next = arrival.segment.acknowledged if self._needs_handshake(now) else None
        request = new_request(setup, arrival, now, acceptor_next)
        self.copies.asked(request)
        if self.sessions.full(request.five_tuple.source):
            return self.verdicts.answer(request, Verdict.REFUSED, Refusal(Reason.BUSY))
        admission = self._admission(request)
        if self._takes_slot(setup, admission):
            return self.grants.reserve(request, now)
        if self.recovery.is_premature(admission.reason, now):
            detail = f"{admission.reason.name} may change soon; TCP repeats it"
            return [Drop("premature", detail, arrival.port)]
        waits = admission.waits_for_light and self.queue.may_wait(setup, request.five_tuple)
        if admission.reason != Reason.OK and not waits:
            return self.verdicts.refuse(request, admission.refusal, now)
        return self._admit(request, admission, waits, now)

    def _admission(self, request: Request) -> Admission:
        setup, connection, terms = request.setup, request.five_tuple, self.terms
        self.sessions.obstacles.clear()
        admission = terms.forbid(setup, connection) or admit(
            setup, connection, self.sessions, terms.network, terms.budget_mdb, terms.policy.taps
        )
        rounds = terms.policy.purification.rounds
        if rounds and admission.paths and setup.service == Service.SWITCH_SWAP and setup.block:
            absorbed = are_stored(admission.paths) and setup.memory != MemoryState.HERALDED
            return admission if absorbed else UNSTORED
        turns = terms.policy.schedule != PARALLEL and not rounds
        return TURNS_OF_HOSTS if admission.chain and turns else admission

    def _takes_slot(self, setup: Setup, admission: Admission) -> bool:
        if not self.grants.slots or setup.handshake != Handshake.FRAMED:
            return False
        return setup.service not in MONITORS and bool(admission.paths or admission.waits_for_light)

    def _admit(
        self, request: Request, admission: Admission, waits: bool, now: float
    ) -> list[Action]:
        request.take(admission.block_pairs, admission.wavelength_pm)
        self.sessions.retired.pop(request.five_tuple, None)
        session = self.sessions.join(request, now)
        if waits:
            return self.queue.wait(request, now)
        if admission.chain:
            policy = self.terms.policy
            return self.ordering.order(
                request, session, admission, policy.schedule, policy.purification
            )
        if not admission.paths:
            return self.verdicts.grant(request)
        if request.setup.service == Service.SWITCH_SWAP:
            hops = (hop for path in admission.paths for hop in path.hops)
            policy = self.terms.policy
            hosts = _hosts(request)
            session.turns = swap_turns(hops, policy.schedule, policy.purification, hosts)
        return self.light.open(request, session, admission.paths)


def _hosts(request: Request) -> Hosts:
    """Return where the hosts are that a set-up message goes between."""
    assert request.held is not None
    acceptor, opener = (request.held.segment.frame[at : at + 6] for at in (0, 6))
    addresses = {Receivers.OPENER: opener, Receivers.ACCEPTOR: acceptor}
    return Hosts(request.held.dpid, addresses)
