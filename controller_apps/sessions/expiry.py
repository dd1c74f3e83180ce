"""The decision which requests and sessions have lasted long enough."""

from dataclasses import dataclass

from controller_apps.sessions.actions import Action
from controller_apps.sessions.chains import beside, links_of
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.ordering import Ordering
from controller_apps.sessions.preempted import PREEMPTED, Preempted
from controller_apps.sessions.sessions import Refusal, Session, Sessions
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts
from controller_apps.timeouts import SWITCH_GRACE_S
from wire.metadata.vocabulary import Reason


@dataclass
class Expiry:
    """Refuses requests, and tears down sessions."""

    sessions: Sessions
    terms: Terms
    light: Light
    verdicts: Verdicts
    ordering: Ordering
    preempted: Preempted

    def refuse_held(self, now: float) -> list[Action]:
        """Refuse requests for which a node or a switch has been silent for too long."""
        actions: list[Action] = []
        for request in list(self.sessions.held.values()):
            if request.unanswered:
                actions += self.ordering.give_up(request, now)
            elif now - request.started >= self.terms.hold_timeout_s:
                actions += self.verdicts.refuse(request, Refusal(Reason.SWITCH_TIMEOUT), now)
        return actions

    def tear_down(self, now: float) -> list[Action]:
        actions: list[Action] = []
        for monitor in self.preempted.late(now):
            actions += self.verdicts.tear_down(monitor, PREEMPTED, now)
        for session in self.light.overdue(now - self.terms.hold_timeout_s):
            actions += self.verdicts.tear_down(session, "no switch in time for the other way", now)
        for session in list(self.sessions.by_number.values()):
            if session.number not in self.sessions.by_number:
                continue  # a link whose chain has just ended
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
        idle_s = self.terms.idle_timeout_s
        if now - session.seen < idle_s or not session.open or session.bypassed:
            return False
        if links_of(session, self.sessions):
            return False  # the traffic of a chain is that of its links
        # A link waits until all of its chain stands, which takes a while if it is long.
        return all(now - link.seen >= idle_s for link in beside(session, self.sessions))
