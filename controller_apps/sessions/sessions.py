"""Sessions, the requests made for them, and which ports their light occupies.

A request is one set-up message on one TCP connection. The connection that registers a
session (FRAMED or PER_PAIR) owns it; others belong to it (ONE_PAIR, PAIR_SOURCE).
"""

from dataclasses import dataclass, field, replace
from math import inf
from typing import NamedTuple

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Direction, Hop, directions
from controller_apps.light.routing import LightPath
from controller_apps.packets import FiveTuple, Segment
from controller_apps.policy.schedules import Waiting
from controller_apps.sessions.holders import Ends, Holders
from controller_apps.sessions.swap_turns import SwapTurns
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode, message_length
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.optical import frequency_mhz

MAX_SESSIONS = 4096
MAX_REQUESTS = 4 * MAX_SESSIONS
MAX_RETIRED = 1024
# Of one opener: nobody keeps all others out.
MAX_OF_ONE = MAX_REQUESTS // 8
MAX_SESSIONS_OF_ONE = MAX_SESSIONS // 8


@dataclass(frozen=True)
class Arrival:
    """A segment that a classical switch has sent to the controller."""

    dpid: int
    in_port: int
    segment: Segment

    @property
    def port(self) -> SwitchPort:
        return SwitchPort(self.dpid, self.in_port)


class Refusal(NamedTuple):
    """Why a request has no light, and the text for hosts."""

    reason: Reason
    detail: str = ""  # for who runs the network
    node: str = ""  # address of the one that the reason is about, if it is about one
    obstacle: str = ""  # for the hosts: which element is in the way


@dataclass
class Request:
    """A set-up message and what has become of it."""

    setup: Setup
    held: Arrival | None  # the message on its way; None once answered
    five_tuple: FiveTuple
    sequence: int  # TCP sequence number of the message
    message: bytes
    started: float
    answer: bytes = b""  # what every copy of the message is released as
    rotation: int = 0
    transaction: int = 0
    waiting: set[int] = field(default_factory=set)  # switches that owe a barrier reply
    seen: dict[int, float] = field(default_factory=dict)  # switches with a copy of it, since when
    unseen: set[int] = field(default_factory=set)  # switches whose copy its light waits for
    bypassed: set[int] = field(default_factory=set)  # switches that let the connection pass
    block_pairs: int = 0  # granted, if it is less than was asked for
    wavelength_pm: int = 0  # granted, if it was left to the controller
    progress: int = SETUP_LENGTH  # how many bytes of the opener have been seen, the message's too
    acceptor_next: int | None = None  # sequence number of the acceptor's next byte, as last seen
    obstacles: frozenset[Direction] = frozenset()  # what others have of what it waits for
    queued_at: int = 0  # how often light had been given back until then
    late: float = inf  # when its deadline is over
    doubted: tuple[int, float] | None = None  # where a close was that nobody expected, and when

    @property
    def lasts(self) -> bool:
        """Whether data will follow on the connection, so that a bypass is worth an entry."""
        return self.setup.service != Service.SDC or self.setup.handshake != Handshake.ONE_PAIR

    @property
    def waiting_for_light(self) -> Waiting:
        """How schedulers see it while it waits."""
        return Waiting(self.started, self.setup.priority, self.late)

    def take(self, block_pairs: int, wavelength_pm: int) -> None:
        """Note what is granted where less, or nothing, was asked for; 0: as was asked."""
        self.block_pairs, self.wavelength_pm = block_pairs, wavelength_pm

    def offset(self, sequence: int) -> int:
        """Return where a sequence number is, in bytes from the beginning of the message."""
        distance = (sequence - self.sequence) & 0xFFFFFFFF
        return distance - (1 << 32) if distance >> 31 else distance

    def heard(self, segment: Segment) -> None:
        self.progress = max(self.progress, self.offset(segment.after))
        if self.acceptor_next is not None:
            self.acceptor_next = segment.acknowledged

    @property
    def granted(self) -> Setup:
        """The set-up with the size of blocks that memories take, and the channel of its light."""
        return replace(self.setup, pairs=self.granted_pairs, wavelength_pm=self.granted_pm)

    @property
    def granted_pairs(self) -> int:
        """The size of its blocks: as was asked, or as memories take."""
        return self.block_pairs or self.setup.pairs

    @property
    def granted_pm(self) -> int:
        """The wavelength of its light: as was asked, or as was granted."""
        return self.wavelength_pm or self.setup.wavelength_pm

    def decide(self, verdict: Verdict, why: Refusal) -> Arrival:
        """Write the answer and return the message that waited for it."""
        assert self.held is not None
        arrival, self.held = self.held, None
        answered = replace(
            self.setup,
            pairs=self.granted_pairs,
            wavelength_pm=self.granted_pm,
            source=why.node or self.setup.source,
            obstacle=why.obstacle,
            verdict=verdict,
            rotation=self.rotation,
            reason=why.reason,
        )
        self.answer = answered.encode()
        return arrival


def read_setup(payload: bytes) -> Setup:
    """Decode the set-up that a payload begins with; what is behind it does not matter."""
    length = message_length(payload)
    message = decode(payload[:length]) if length is not None else None
    if not isinstance(message, Setup):
        raise MalformedPacket(f"{len(payload)} bytes that do not begin with a set-up message")
    return message


def new_request(
    setup: Setup, arrival: Arrival, now: float, acceptor_next: int | None = None
) -> Request:
    """Return a request that waits for its answer; of the acceptor a handshake may be known."""
    segment = arrival.segment
    message = segment.payload[:SETUP_LENGTH]
    request = Request(setup, arrival, segment.five_tuple, segment.sequence, message, now)
    request.acceptor_next = acceptor_next
    if setup.deadline_ms:
        request.late = now + setup.deadline_ms / 1000
    return request


@dataclass
class Session:
    number: int
    setup: Setup
    owner: FiveTuple
    seen: float
    open: bool = False  # its owner has been granted
    requests: dict[FiveTuple, Request] = field(default_factory=dict)
    paths: tuple[LightPath, ...] = ()
    light_owner: FiveTuple | None = None  # whose connection keeps the paths open
    stranded: bool = False  # its light is lost, and there is no other way
    lost_since: float | None = None  # when a switch that it cannot do without has gone
    saved: bool = False  # for another controller
    resumed: float | None = None  # when it was taken over from another controller; None: judged
    confirmed: bool = True  # by a switch, since it was taken over
    turns: SwapTurns | None = None  # of switches that swap; None: as soon as possible
    missing: tuple[Hop, ...] = ()  # that switches have lost, to be opened when it is confirmed

    @property
    def hops(self) -> tuple[Hop, ...]:
        return tuple(hop for path in self.paths for hop in path.hops)

    @property
    def wavelength_pm(self) -> int:
        """The wavelength of its light: as was asked, or as was granted to its owner."""
        owner = self.requests.get(self.owner)
        return owner.granted_pm if owner else self.setup.wavelength_pm

    @property
    def frequency_mhz(self) -> int:
        """The frequency of its light; of any channel, before it has one, the default's."""
        return frequency_mhz(self.wavelength_pm or Setup.wavelength_pm)

    @property
    def ends(self) -> Ends:
        return self.owner.source, self.owner.destination

    def heard(self, now: float) -> None:
        self.seen, self.confirmed = now, True

    @property
    def bypassed(self) -> bool:
        return any(request.bypassed for request in self.requests.values())

    @property
    def doubted(self) -> bool:
        """Whether it may be over: a switch has yet to count what its connection has carried."""
        owners = (
            self.requests.get(connection)
            for connection in (self.owner, self.light_owner)
            if connection
        )
        return any(request is not None and request.doubted is not None for request in owners)


@dataclass
class Sessions:
    """All of them; `occupied` tells which session has a port in one direction.

    Requests without a session are retired: kept for a while, because TCP may repeat what
    it sent before the end, and such segments have to pass.
    """

    by_number: dict[int, Session] = field(default_factory=dict)
    requests: dict[FiveTuple, Request] = field(default_factory=dict)
    held: dict[int, Request] = field(default_factory=dict)  # by transaction
    queue: dict[FiveTuple, Request] = field(default_factory=dict)  # that wait for light, in order
    retired: dict[FiveTuple, float] = field(default_factory=dict)  # since when
    occupied: dict[Direction, int] = field(default_factory=dict)
    freed: set[Direction] = field(default_factory=set)  # since the queue was served
    holders: Holders = field(default_factory=Holders)
    changed: bool = False  # whether anything else has since then that light depends on
    obstacles: set[Direction] = field(
        default_factory=set
    )  # that `blocks` has met; cleared by users
    ended: dict[int, Ends] = field(default_factory=dict)  # the last ones' two ends
    over: dict[int, frozenset[str]] = field(default_factory=dict)
    # Seals that are to cross a fibre between two switches, given by their names; empty: any way.
    max_sessions: int = MAX_SESSIONS
    max_requests: int = MAX_REQUESTS
    max_retired: int = MAX_RETIRED
    max_of_one: int = MAX_OF_ONE
    max_sessions_of_one: int = MAX_SESSIONS_OF_ONE

    def full(self, opener: str) -> bool:
        """Whether another request of an opener, by its address, has no place."""
        if len(self.requests) >= self.max_requests:
            return True
        if len(self.requests) < self.max_of_one:
            return False
        return sum(connection.source == opener for connection in self.requests) >= self.max_of_one

    def no_place(self, opener: str) -> str:
        """Return why another session of an opener, by its address, has no place; "" if it has."""
        count = len(self.by_number)
        if count >= self.max_sessions:
            return f"{count} sessions are under way"
        if count < self.max_sessions_of_one:
            return ""
        theirs = sum(session.owner.source == opener for session in self.by_number.values())
        if theirs < self.max_sessions_of_one:
            return ""
        return f"{theirs} sessions of {opener} are under way, its share"

    def of(self, request: Request) -> Session | None:
        session = self.by_number.get(request.setup.session)
        if session is None or session.requests.get(request.five_tuple) is not request:
            return None
        return session

    def join(self, request: Request, now: float) -> Session:
        """Put a request into its session, which it opens if there is none."""
        number = request.setup.session
        if number not in self.by_number:
            self.by_number[number] = Session(number, request.setup, request.five_tuple, now)
        session = self.by_number[number]
        session.heard(now)
        session.requests[request.five_tuple] = request
        self.requests[request.five_tuple] = request
        return session

    def remove(self, session: Session) -> None:
        """Take out one that is over; for a while its ends may still tell of it."""
        del self.by_number[session.number]
        self.ended[session.number] = session.ends
        if len(self.ended) > self.max_retired:
            del self.ended[next(iter(self.ended))]

    def is_end(self, number: int, address: str) -> bool:
        session = self.by_number.get(number)
        if session is None:
            return address in self.ended.get(number, ())
        return address in session.ends

    def occupy(
        self, session: Session, paths: tuple[LightPath, ...], owner: FiveTuple | None
    ) -> None:
        self.vacate(session)
        session.paths, session.light_owner = paths, owner
        self.occupied.update(dict.fromkeys(directions(session.hops), session.number))

    def vacate(self, session: Session) -> None:
        path = directions(session.hops)
        for direction in path:
            del self.occupied[direction]
            self.freed |= {direction, direction.opposite}  # which it may have tuned otherwise
        if path:
            self.holders.gave_back(path, session.number, session.ends, session.frequency_mhz)
        session.paths, session.light_owner = (), None
        session.stranded, session.lost_since, session.missing = False, None, ()

    def blocks(self, direction: Direction, session: int, frequency_mhz: int) -> bool:
        """Tell whether others keep a session's light of this frequency out of a port.

        Nobody shares a direction, and both directions of a port have one tuning.
        """
        occupied = self.occupied
        blocked = occupied.get(direction, session) != session
        if not blocked and (other := occupied.get(direction.opposite, session)) != session:
            blocked = self.by_number[other].frequency_mhz != frequency_mhz
        if blocked:
            self.obstacles.add(direction)
        return blocked

    def retire(self, request: Request, now: float) -> None:
        """Keep a request that is over, and forget the oldest of such if there are many."""
        session = self.of(request)
        if session is not None:
            del session.requests[request.five_tuple]
        self.requests[request.five_tuple] = request
        self.retired.pop(request.five_tuple, None)  # the order is that of the times
        self.retired[request.five_tuple] = now
        if len(self.retired) > self.max_retired:
            self.forget(next(iter(self.retired)))

    def forget(self, five_tuple: FiveTuple) -> None:
        del self.retired[five_tuple]
        del self.requests[five_tuple]

    def forget_retired_before(self, moment: float) -> None:
        """Remove the requests that were retired until then."""
        while self.retired:
            five_tuple, since = next(iter(self.retired.items()))  # the oldest
            if since > moment:
                return
            self.forget(five_tuple)
