"""The outcomes of requests and sessions (granted, refused, over) and their consequences."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import Action, Forget, Forward, Note, RemoveBypass
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.returns import returns_of
from controller_apps.sessions.sessions import Arrival, Refusal, Request, Session, Sessions
from controller_apps.sessions.snapshot import keep
from controller_apps.sessions.terms import Terms
from wire.metadata.vocabulary import Reason, Verdict
from wire.verdict import seal


@dataclass
class Verdicts:
    sessions: Sessions
    light: Light
    terms: Terms
    keys: Mapping[str, str] = field(default_factory=dict)  # device keys, by address of the host

    def grant(self, request: Request, *notes: Note) -> list[Action]:
        """Release a request; its session is open from now on."""
        session = self.sessions.of(request)
        assert session is not None
        session.open = True
        answer = self.answer(request, Verdict.GRANTED, Refusal(Reason.OK))
        # Kept first: a session that hosts know must outlive this controller.
        copy = [keep(session)] if request.lasts else []
        return [*copy, *notes, Note("granted", session.number, asked=request), *answer]

    def refuse(self, request: Request, why: Refusal, now: float) -> list[Action]:
        """Release a request with a refusal; undo its effects."""
        assert request.held is not None
        at = request.held.port
        undone = self._leave(request, now)
        name = why.reason.name
        detail = f"{name}: {why.detail}" if why.detail else name
        note = Note("refused", request.setup.session, detail=detail, at=at, asked=request)
        if not self.terms.policy.names_elements:
            why = why._replace(obstacle="")
        return [*undone, note, *self.answer(request, Verdict.REFUSED, why)]

    def answer(self, request: Request, verdict: Verdict, why: Refusal) -> list[Action]:
        self.sessions.held.pop(request.transaction, None)
        self.sessions.queue.pop(request.five_tuple, None)
        arrival = request.decide(verdict, why)
        self.seal(request)
        return [released(request, arrival)]

    def seal(self, request: Request) -> None:
        request.answer = self.sealed(request.answer, request.five_tuple)

    def sealed(self, message: bytes, five_tuple: FiveTuple) -> bytes:
        key = self.keys.get(five_tuple.destination)
        return seal(message, key, five_tuple) if key else message

    def over(self, request: Request, cause: str, now: float) -> list[Action]:
        if request.held is not None:
            # It must pass, or TCP would repeat it for minutes.
            return self.refuse(request, Refusal(Reason.PEER_GONE, cause), now)
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
            actions = self._leave_others(session, request, now)
        self.sessions.retire(request, now)
        return actions

    def _leave_others(self, session: Session, request: Request, now: float) -> list[Action]:
        session.heard(now)
        actions = self._punt_again(request)
        if session.light_owner == request.five_tuple:
            actions += self.light.close(session)
        self.sessions.retire(request, now)
        copy = [keep(session)] if session.saved and request.lasts else []
        return [*copy, *actions]

    def tear_down(self, session: Session, cause: str, now: float) -> list[Action]:
        return [*self._end(session, now), Note("torn_down", session.number, detail=cause)]

    def _end(self, session: Session, now: float) -> list[Action]:
        # Forgotten first: nothing may be opened again for an ended session.
        returns = returns_of(session, self.sessions)
        forgotten = [Forget(session.number)] if session.saved else []
        actions = [*forgotten, *self.light.close(session)]
        members = list(session.requests.values())
        self.sessions.remove(session)
        for request in members:
            actions += self._punt_again(request)
            if request.held is not None and request.five_tuple != session.owner:
                actions += self.answer(request, Verdict.REFUSED, Refusal(Reason.UNKNOWN_SESSION))
            self.sessions.retire(request, now)
        for part in returns:
            request = part.requests[part.owner]
            if request.held is not None:
                actions += self.refuse(request, Refusal(Reason.UNKNOWN_SESSION), now)
            else:
                actions += self.tear_down(part, "the session of its light is over", now)
        return actions

    def _punt_again(self, request: Request) -> list[Action]:
        removals: list[Action] = [
            RemoveBypass(dpid, request.five_tuple, request.setup.session)
            for dpid in sorted(request.bypassed)
        ]
        request.bypassed.clear()
        return removals


def released(request: Request, arrival: Arrival) -> Forward:
    """Return a segment with the answer alone; TCP repeats the data behind it."""
    frame = arrival.segment.with_payload(request.answer)
    return Forward(arrival.dpid, arrival.in_port, frame)
