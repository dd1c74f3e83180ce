"""The decision on a set-up message: drop it, refuse it, queue it, or open its light."""

from dataclasses import dataclass

from controller_apps.sessions.actions import Action, Drop, Forward, Note
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
    Sessions,
    new_request,
    read_setup,
)
from controller_apps.sessions.slots import SlotGrants
from controller_apps.sessions.swap_turns import Hosts, are_stored, swap_turns
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts
from wire.analyser_frames import Receivers
from wire.metadata.header import session_of
from wire.metadata.setup import SETUP_LENGTH, Setup, refused
from wire.metadata.vocabulary import (
    Handshake,
    Reason,
    Service,
    UnknownService,
    Verdict,
)
from wire.services import MONITORS

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
        swaps = admission.paths and setup.service == Service.SWAP and setup.block
        if not swaps or not terms.policy.purification.rounds:
            return admission
        return admission if are_stored(admission.paths) else UNSTORED

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
        if not admission.paths:
            return self.verdicts.grant(request)
        if request.setup.service == Service.SWAP:
            hops = (hop for path in admission.paths for hop in path.hops)
            policy = self.terms.policy
            session.turns = swap_turns(hops, policy.schedule, policy.purification, _hosts(request))
        return self.light.open(request, session, admission.paths)


def _hosts(request: Request) -> Hosts:
    assert request.held is not None
    acceptor, opener = (request.held.segment.frame[at : at + 6] for at in (0, 6))
    addresses = {Receivers.OPENER: opener, Receivers.ACCEPTOR: acceptor}
    return Hosts(request.setup.session, request.held.dpid, addresses)
