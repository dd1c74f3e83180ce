"""Light in time slots: a request reserves a slot, and has the light of it while it lasts."""

from dataclasses import dataclass
from math import inf

from controller_apps.light.paths import Network
from controller_apps.policy.orders import SLOTS, Queue
from controller_apps.sessions.actions import Action
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.light_queue import LightQueue
from controller_apps.sessions.sessions import Refusal, Request, Sessions
from controller_apps.sessions.slots import Reserved, Slots
from controller_apps.sessions.verdicts import Verdicts
from wire.metadata.vocabulary import Reason


@dataclass
class SlotGrants:
    """Reserves slots, and gives and takes their light at the borders between them."""

    sessions: Sessions
    network: Network
    queue: LightQueue
    verdicts: Verdicts
    slots: Slots | None = None  # None: the policy has no slots

    def follow(self, queue: Queue) -> None:
        """Begin or end slots as the policy says; what was reserved in slots as long is kept."""
        if queue.order != SLOTS:
            self.slots = None
        elif self.slots is None or self.slots.slot_s != queue.slot_s:
            self.slots = Slots(self.sessions, queue.slot_s)

    def next_start(self, now: float) -> float:
        """Return when the next slot begins; infinity without slots."""
        return inf if self.slots is None else self.slots.next_start(now)

    def reserve(self, request: Request, now: float) -> list[Action]:
        """Queue a request for a slot, or refuse it if none is free in time."""
        assert self.slots is not None
        self.sessions.retired.pop(request.five_tuple, None)
        self.sessions.join(request, now)
        terms = self.queue.terms
        admission = self.slots.reserve(
            request, min(request.late, now + terms.hold_timeout_s), now, self._find_beside
        )
        if admission.paths:
            return self.queue.append(request)
        no_deadline = admission.reason == Reason.TOO_LATE and request.late == inf
        reason = Reason.BUSY if no_deadline else admission.reason
        return self.verdicts.refuse(request, admission.refusal._replace(reason=reason), now)

    def _find_beside(self, request: Request, sessions: Sessions) -> Admission:
        return self.queue.terms.find_light(request.setup, request.five_tuple, sessions)

    def hand_over(self, now: float) -> list[Action]:
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
            actions += self._begin(request, reserved, now)
        return actions

    def _begin(self, request: Request, reserved: Reserved, now: float) -> list[Action]:
        assert self.slots is not None
        session = self.sessions.of(request)
        assert session is not None  # it waits
        del self.sessions.queue[request.five_tuple]
        request.take(reserved.block_pairs, reserved.wavelength_pm)
        hops = (hop for path in reserved.paths for hop in path.hops)
        if self.network.is_whole(hops) and self.slots.is_free(session, reserved):
            return self.queue.open(request, session, reserved.paths)
        admission = self.queue.find(request)
        if admission.paths:
            return self.queue.open(request, session, admission.paths)
        return self.verdicts.refuse(request, admission.refusal, now)
