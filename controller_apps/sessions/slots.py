"""Time slots of light: each request has one in which its paths are its own, or none before its end.

    now      slot 7            slot 8            slot 9
    |........|-----------------|-----------------|---------
      asked: a b c d           a, b              c           d is refused: its deadline is in slot 9

Slots follow each other without a gap, and are numbered from 0 on the controller's clock. Reserved
light is opened when the slot begins; a session that still has it when it ends loses it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf

from controller_apps.light.paths import Direction, Network, directions
from controller_apps.light.routing import LightPath
from controller_apps.packets import FiveTuple
from controller_apps.policy.schedules import SLOTS, Queue
from controller_apps.sessions.actions import Action
from controller_apps.sessions.admission import Admission
from controller_apps.sessions.light_queue import LightQueue
from controller_apps.sessions.sessions import Refusal, Request, Session, Sessions
from controller_apps.sessions.verdicts import Verdicts
from wire.metadata.vocabulary import Reason
from wire.optical import frequency_mhz

ROUNDING = 1e-6  # of a slot: a moment that is that of its begin is not before it
Find = Callable[[Request, Sessions], Admission]


@dataclass(frozen=True)
class Reserved:
    slot: int
    paths: tuple[LightPath, ...]
    block_pairs: int
    wavelength_pm: int


@dataclass
class Slots:
    sessions: Sessions
    slot_s: float
    reserved: dict[FiveTuple, Reserved] = field(default_factory=dict)
    _taken: dict[int, dict[Direction, int]] = field(default_factory=dict)
    _given: dict[int, int] = field(default_factory=dict)  # slot by session, of those that had light

    def number(self, now: float) -> int:
        return int(now / self.slot_s + ROUNDING)

    def next_start(self, now: float) -> float:
        return (self.number(now) + 1) * self.slot_s

    def reserve(self, request: Request, until: float, now: float, find: Find) -> Admission:
        """Give a request the first slot that can carry it and begins by then; return why not.

        `find` looks for its light beside the given sessions.
        """
        self._forget_those_over()
        slot = self.number(now) + 1
        admission = Admission(Reason.TOO_LATE)
        while slot * self.slot_s <= until:
            taken = self._taken.get(slot, {})
            admission = find(request, replace(self.sessions, occupied=taken, obstacles=set()))
            if admission.paths:
                reserved = Reserved(
                    slot, admission.paths, admission.block_pairs, admission.wavelength_pm
                )
                hops = (hop for path in admission.paths for hop in path.hops)
                number = request.setup.session
                self._taken.setdefault(slot, {}).update(dict.fromkeys(directions(hops), number))
                self.reserved[request.five_tuple] = reserved
                return admission
            if not admission.waits_for_light:
                return admission
            admission, slot = Admission(Reason.TOO_LATE), slot + 1
        return admission

    def due(self, now: float) -> list[tuple[Request, Reserved]]:
        """Return the requests whose slot has begun; they are given light, or refused."""
        self._forget_those_over()
        number = self.number(now)
        begun = [key for key, reserved in self.reserved.items() if reserved.slot <= number]
        pairs = [(self.sessions.requests[key], self.reserved.pop(key)) for key in begun]
        self._given.update((request.setup.session, reserved.slot) for request, reserved in pairs)
        for slot in [slot for slot in self._taken if slot < number]:
            del self._taken[slot]
        return pairs

    def over(self, now: float) -> list[Session]:
        number = self.number(now)
        ended = [session for session, slot in self._given.items() if slot < number]
        for session in ended:
            del self._given[session]
        by_number = self.sessions.by_number
        return [by_number[session] for session in ended if session in by_number]

    def is_free(self, session: Session, reserved: Reserved) -> bool:
        hops = (hop for path in reserved.paths for hop in path.hops)
        frequency = frequency_mhz(reserved.wavelength_pm or session.setup.wavelength_pm)
        return not any(
            self.sessions.blocks(path, session.number, frequency) for path in directions(hops)
        )

    def _forget_those_over(self) -> None:
        for five_tuple in self.reserved.keys() - self.sessions.queue.keys():
            reserved = self.reserved.pop(five_tuple)
            taken = self._taken[reserved.slot]
            for direction in directions(hop for path in reserved.paths for hop in path.hops):
                del taken[direction]


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
