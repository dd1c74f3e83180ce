"""The decision on sessions whose light a switch or a fibre has failed: move, wait, or end them."""

from dataclasses import dataclass

from controller_apps.light.paths import Network, switches
from controller_apps.sessions.actions import Action
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.link_monitors import PREEMPTED, Preempted
from controller_apps.sessions.sessions import Refusal, Request, Session, Sessions
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts
from controller_apps.timeouts import SWITCH_GRACE_S
from wire.metadata.vocabulary import Reason


@dataclass
class Expiry:
    sessions: Sessions
    terms: Terms
    light: Light
    verdicts: Verdicts
    preempted: Preempted

    def refuse_held(self, now: float) -> list[Action]:
        """Refuse requests for which a switch has been silent for too long."""
        actions: list[Action] = []
        for request in list(self.sessions.held.values()):
            if now - request.started >= self.terms.hold_timeout_s:
                actions += self.verdicts.refuse(request, self._why_held(request), now)
        return actions

    def _why_held(self, request: Request) -> Refusal:
        names = ", ".join(map(self.light.network.name_of, sorted(request.unseen)))
        return Refusal(Reason.SETUP_UNSEEN if names else Reason.SWITCH_TIMEOUT, names, "", names)

    def tear_down(self, now: float) -> list[Action]:
        actions: list[Action] = []
        for monitor in self.preempted.late(now):
            actions += self.verdicts.tear_down(monitor, PREEMPTED, now)
        for session in self.light.overdue(now - self.terms.hold_timeout_s):
            actions += self.verdicts.tear_down(session, "no switch in time for the other way", now)
        for session in list(self.sessions.by_number.values()):
            if session.number not in self.sessions.by_number:
                continue  # a return whose session has just ended
            if cause := self._end(session, now):
                actions += self.verdicts.tear_down(session, cause, now)
        return actions

    def _end(self, session: Session, now: float) -> str:
        if session.lost_since is not None and now - session.lost_since >= SWITCH_GRACE_S:
            return "switch gone"
        if session.resumed is not None and now - session.resumed < SWITCH_GRACE_S:
            return ""  # a switch may still confirm it
        session.resumed = None
        if not session.confirmed:
            return "no switch has kept it"
        return "idle" if self._is_idle(session, now) else ""

    def _is_idle(self, session: Session, now: float) -> bool:
        silent = now - session.seen >= self.terms.idle_timeout_s
        return silent and session.open and not session.bypassed


@dataclass
class Repairs:
    network: Network
    sessions: Sessions
    light: Light
    verdicts: Verdicts

    def network_changed(self, now: float) -> list[Action]:
        self.sessions.changed = True
        actions: list[Action] = []
        for session in self.sessions.by_number.values():
            actions += self.mend(session, now)
        return actions

    def mend(self, session: Session, now: float) -> list[Action]:
        """Move a session if its light cannot pass; without another path it is stranded."""
        if self.network.connected.issuperset(switches(session.hops)):
            session.lost_since = None
        elif session.resumed is not None:
            return []  # its switches have yet to connect to this controller
        if not self.light.is_broken(session):
            session.stranded = False
            return []
        if _light_owner(session).held is not None:
            return []  # not before it is granted
        moved = self.light.move(session, now)
        return self.light.strand(session) if moved is None else moved

    def switch_left(self, dpid: int, now: float) -> list[Action]:
        """Move the sessions of a switch that is gone; one without another path has some time."""
        self.network.connected.discard(dpid)
        self.sessions.changed = True  # requests that wait may have to be refused
        self.light.switch_left(dpid)
        for request in self.sessions.requests.values():
            request.bypassed.discard(dpid)
        actions: list[Action] = []
        for session in list(self.sessions.by_number.values()):
            if dpid in switches(session.hops):
                actions += self._switch_lost(session, now)
        return actions

    def _switch_lost(self, session: Session, now: float) -> list[Action]:
        request = _light_owner(session)
        if request.held is not None:
            return self.verdicts.refuse(request, Refusal(Reason.SWITCH_FAILED), now)
        moved = self.light.move(session, now)
        if moved is None:
            session.lost_since = now  # its bridge keeps the paths; it may be back soon
        return moved or []

    def switch_refused(self, transaction: int, now: float) -> list[Action]:
        request = self.sessions.held.get(transaction)
        if request is not None:
            session = self.sessions.of(request)
            assert session is not None
            self.light.doubt_tuning(session)
            return self.verdicts.refuse(request, Refusal(Reason.SWITCH_FAILED), now)
        move = self.light.moves.get(transaction)
        if move is None:
            return []
        session = self.sessions.by_number[move.session]
        self.light.doubt_tuning(session)
        return self.verdicts.tear_down(session, "the switch refused the other way", now)


def _light_owner(session: Session) -> Request:
    assert session.light_owner is not None
    return session.requests[session.light_owner]
