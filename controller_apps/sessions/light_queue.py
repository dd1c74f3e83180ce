"""Requests that wait for light: who waits, and who is served next.

    request --light is taken--> queued --light is free--> opened
                                   `--deadline, hold time--> refused

A request whose light is still taken keeps no other from light that is free.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

from controller_apps.light.paths import directions
from controller_apps.light.routing import LightPath
from controller_apps.packets import FiveTuple
from controller_apps.policy.schedules import ORDERS
from controller_apps.sessions.actions import Action, Note
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.light_paths import Light
from controller_apps.sessions.link_monitors import PREEMPTED, Preempted
from controller_apps.sessions.sessions import Refusal, Request, Session, Sessions
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts
from controller_apps.timeouts import QUEUE_LOOK_S
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason
from wire.services import MONITORS


@dataclass
class LightQueue:
    """Puts requests into `sessions.queue`, and gives them light in the policy's order."""

    sessions: Sessions
    terms: Terms
    light: Light
    verdicts: Verdicts
    preempted: Preempted
    _looked: float = -inf

    def may_wait(self, setup: Setup, connection: FiveTuple) -> bool:
        """Return whether a request waits: always if so configured, else if its light is free soon.

        A link monitor never waits.
        """
        if setup.service in MONITORS:
            return False
        return self.terms.queues or self._is_free_soon(setup, connection)

    def _is_free_soon(self, setup: Setup, connection: FiveTuple) -> bool:
        """Return whether link monitors, or sessions with an unconfirmed close, have the light."""
        sessions = self.sessions
        ending = {
            session.number
            for session in sessions.by_number.values()
            if session.setup.service in MONITORS or session.doubted
        }
        if not ending:
            return False
        occupied = {
            path: holder for path, holder in sessions.occupied.items() if holder not in ending
        }
        others = replace(sessions, occupied=occupied, obstacles=set())
        return bool(self.terms.find_light(setup, connection, others).paths)

    def wait(self, request: Request, now: float) -> list[Action]:
        request.obstacles = frozenset(self.sessions.obstacles)
        return [*self.append(request), *self._preempt(request, now)]

    def append(self, request: Request) -> list[Action]:
        request.queued_at = self.sessions.holders.order
        self.sessions.queue[request.five_tuple] = request
        return [Note("queued", request.setup.session, asked=request)]

    def _preempt(self, request: Request, now: float) -> list[Action]:
        actions: list[Action] = []
        for monitor in self.preempted.holders(request):
            owner = monitor.requests[monitor.owner]
            if owner.held is not None:  # it has not begun
                actions += self.verdicts.refuse(owner, Refusal(Reason.BUSY, PREEMPTED), now)
            else:
                actions += self.preempted.end(monitor, now)
        return actions

    def serve(self, now: float) -> list[Action]:
        """Give light that has become free, in the policy's order."""
        freed, changed = self.sessions.freed, self.sessions.changed
        self.sessions.freed, self.sessions.changed = set(), False
        if not self.sessions.queue or not (freed or changed):
            return []
        place = ORDERS[self.terms.policy.queue.order]
        waiting = sorted(
            self.sessions.queue.values(), key=lambda request: place(request.waiting_for_light)
        )
        actions: list[Action] = []
        for request in waiting:
            if changed or not freed.isdisjoint(request.obstacles):
                actions += self._serve(request, now)
        return actions

    def _serve(self, request: Request, now: float) -> list[Action]:
        session = self.sessions.of(request)
        if session is None:
            return []  # it has ended meanwhile
        admission = self.find(request)
        if admission.paths:
            del self.sessions.queue[request.five_tuple]
            request.take(admission.block_pairs, admission.wavelength_pm)
            return self.open(request, session, admission.paths)
        if not admission.waits_for_light:
            return self.verdicts.refuse(request, admission.refusal, now)
        return self._preempt(request, now)

    def find(self, request: Request) -> Admission:
        self.sessions.obstacles.clear()
        admission = self.terms.find_light(request.setup, request.five_tuple, self.sessions)
        request.obstacles = frozenset(self.sessions.obstacles)
        return admission

    def open(self, request: Request, session: Session, paths: Sequence[LightPath]) -> list[Action]:
        after = self.sessions.holders.last(
            directions(hop for path in paths for hop in path.hops),
            session.number,
            session.frequency_mhz,
            request.queued_at,
        )
        opening = self.light.open(request, session, tuple(paths))
        if after is None:
            return opening
        return [Note("light_after", session.number, ends=session.ends, after=after), *opening]

    def expire(self, now: float) -> list[Action]:
        actions: list[Action] = []
        for request in list(self.sessions.queue.values()):
            if now >= request.late:
                actions += self.verdicts.refuse(request, Refusal(Reason.TOO_LATE), now)
            elif now - request.started >= self.terms.hold_timeout_s:
                actions += self.verdicts.refuse(request, Refusal(Reason.BUSY), now)
        return actions

    def look_again(self, now: float) -> None:
        """Let all requests be looked at, now and then: losses and tunings change, too."""
        if now - self._looked >= QUEUE_LOOK_S:
            self._looked, self.sessions.changed = now, True
