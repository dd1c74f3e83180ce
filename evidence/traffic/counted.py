"""The controller's own arbiter in counted time: requests come, wait, have light and go.

    opener            controller            switches         acceptor
      |--- set-up ------> |                    |                |
      |                   |--- open ---------> |                |     each way takes its time
      |                   | <----- barrier --- |                |
      |                   |--- set-up -------- | -------------> |
      | <--------- answer | ------------------ | -------------- |
      |=== light for the holding time ==========================|
      |--- FIN ---------> |

Real set-up messages and the controller's own decisions; a time that is counted takes the place of
the clock, so that thousands of sessions take seconds.
"""

import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from ipaddress import IPv4Address
from itertools import count
from math import inf

from controller_apps.sessions.actions import Action, Note, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.timeouts import SESSION_TICK_S
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Service

S1 = 1 << 32  # datapath id of the classical switch, none of a quantum one
FIRST_SEQUENCE = 100
PUSH, FIN, ACK = 8, 1, 16
GIVEN_UP = "GIVEN_UP"  # by its opener, which is not a Reason of wire.metadata
_ETHERNET_IP, _TCP = struct.Struct("!12sH BBHHHBBH4s4s"), struct.Struct("!HHIIBBHHH")


def segment(
    ends: tuple[str, str], source_port: int, sequence: int, flags: int, payload: bytes = b""
) -> bytes:
    """Return a frame of a connection to the metadata port; nobody here looks at checksums."""
    source, destination = (IPv4Address(end).packed for end in ends)
    ip = _ETHERNET_IP.pack(
        bytes(12), 0x0800, 0x45, 0, 40 + len(payload), 0, 0, 64, 6, 0, source, destination
    )
    tcp = _TCP.pack(source_port, METADATA_PORT, sequence, 1, 5 << 4, flags | ACK, 65_535, 0, 0)
    return ip + tcp + payload


@dataclass(frozen=True)
class Asked:
    """A request: two hosts by address, of which the opener makes the photons, or another host."""

    at_s: float
    opener: str
    acceptor: str
    holding_s: float
    priority: int = 0
    deadline_s: float = 0.0  # from the request on; 0: none
    source: str = ""  # another host than the opener that makes the photons
    service: Service = Service["BB84"]
    # Both directions of a port have one tuning: light of a wavelength of its own has fibres alone.
    wavelength_pm: int = Setup.wavelength_pm
    useful_s: float = inf  # without light so long after the request its opener gives up


@dataclass
class Fate:
    """The fate of a request, in its opener's time."""

    asked: Asked
    light_s: float | None = None  # when it may use its light
    reason: str = ""  # of a refusal

    @property
    def waited_s(self) -> float | None:
        """How long it was without light, if it has had some."""
        return None if self.light_s is None else self.light_s - self.asked.at_s

    @property
    def used(self) -> bool:
        return self.waited_s is not None and self.waited_s <= self.asked.useful_s


Event = Callable[[float], Iterable[Action]]


class CountedTime:
    """An arbiter, and all that happens to it."""

    def __init__(
        self,
        arbiter: Arbiter,
        away_s: Callable[[str | int], float] = lambda _place: 0.0,
        then: Callable[[Fate, float], Asked | None] = lambda _fates, _now: None,
    ) -> None:
        """`away_s` says how long a message takes to a host (address) or a switch (datapath id).

        `then` says what an opener asks for when a request is over for it, now or later.
        """
        self._arbiter, self._away_s, self._then = arbiter, away_s, then
        self._events: list[tuple[float, int, Event]] = []
        self._order = count()
        self._fates: dict[int, Fate] = {}

    def run(self, requests: Sequence[Asked]) -> list[Fate]:
        """Let all of them happen; return what becomes of each, in the order that they come up."""
        for request in requests:
            self._ask(request)
        self._at(SESSION_TICK_S, self._tick)
        while self._events:
            now, _order, happens = heappop(self._events)
            self._obey(happens(now), now)
        return list(self._fates.values())

    def _ask(self, demand: Asked) -> None:
        number = len(self._fates) + 1
        self._fates[number] = Fate(demand)
        self._at(demand.at_s + self._away_s(demand.opener), self._asking(number, demand))
        if demand.useful_s < inf:
            self._at(demand.at_s + demand.useful_s, self._given_up(number))

    def _given_up(self, number: int) -> Event:
        fate = self._fates[number]

        def happens(now: float) -> Iterable[Action]:
            if fate.light_s is not None or fate.reason:
                return ()  # or they are on their way
            fate.reason = GIVEN_UP
            return self._ends(number)(now)

        return happens

    def _ends(self, number: int) -> Event:
        """Have the opener ask for what comes next, and then close this."""
        over, opener = self._over(number), self._fates[number].asked.opener
        fin = self._saying(number, FIRST_SEQUENCE + SETUP_LENGTH, FIN)

        def happens(now: float) -> Iterable[Action]:
            over(now)
            self._at(now + self._away_s(opener), fin)
            return ()

        return happens

    def _over(self, number: int) -> Event:
        def happens(now: float) -> Iterable[Action]:
            request = self._then(self._fates[number], now)
            if request is not None:
                self._ask(request)
            return ()

        return happens

    def _tick(self, now: float) -> Iterable[Action]:
        if self._events or self._arbiter.sessions.queue:
            self._at(min(now + SESSION_TICK_S, self._arbiter.next_slot_s(now)), self._tick)
        return self._arbiter.tick(now)

    def _at(self, when_s: float, happens: Event) -> None:
        heappush(self._events, (when_s, next(self._order), happens))

    def _asking(self, number: int, demand: Asked) -> Event:
        setup = Setup(
            *(number, demand.service, Handshake.FRAMED, demand.source or demand.opener, 1, 1, 1),
            priority=demand.priority,
            deadline_ms=round(demand.deadline_s * 1000),
            wavelength_pm=demand.wavelength_pm,
        )
        return self._saying(number, FIRST_SEQUENCE, PUSH, setup.encode())

    def _saying(self, number: int, sequence: int, flags: int, data: bytes = b"") -> Event:
        request = self._fates[number].asked
        ends, port = (request.opener, request.acceptor), 1_024 + number % 60_000
        frame = segment(ends, port, sequence, flags, data)
        return lambda now: self._arbiter.segment_arrived(S1, 1, frame, now)

    def _obey(self, actions: Iterable[Action], now: float) -> None:
        for action in actions:
            if isinstance(action, OpenPaths):
                self._opening(action, now)
            elif isinstance(action, Note) and action.event == "path_ready":
                self._ready(action.session, now)
            elif isinstance(action, Note) and action.event == "refused":
                self._refused(action.session, action.detail, now)

    def _opening(self, action: OpenPaths, now: float) -> None:
        done_s = now + 2 * self._away_s(action.dpid)
        number = action.transaction
        self._at(done_s, lambda at: self._arbiter.barrier_passed(action.dpid, number, at))

    def _ready(self, number: int, now: float) -> None:
        fate = self._fates[number]
        if fate.reason == GIVEN_UP:
            return  # its FIN is on its way
        opener_s = self._away_s(fate.asked.opener)
        fate.light_s = now + 2 * self._away_s(fate.asked.acceptor) + opener_s
        held_s = fate.asked.holding_s if fate.used else 0.0
        self._at(fate.light_s + held_s, self._ends(number))

    def _refused(self, number: int, reason: str, now: float) -> None:
        fate = self._fates[number]
        if fate.reason == GIVEN_UP:
            return
        fate.reason = reason
        heard_s = now + 2 * self._away_s(fate.asked.acceptor) + self._away_s(fate.asked.opener)
        self._at(heard_s, self._over(number))
