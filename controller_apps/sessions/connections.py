"""The decision on a segment of a connection whose set-up is known: pass, drop, or end its request.

A FIN or RST is believed if it fits the sequence numbers that the controller has seen. Data that
passes by a bypass it does not see: then a close further on is compared with the bytes that the
switch has counted, and somebody who cannot see the connection can only guess.

TCP connections to the metadata port that have begun, by the answers of their acceptors.

    opener --SYN, seq a-->              <--SYN ACK, seq b, ack a+1-- acceptor
           --set-up, seq a+1, ack b+1-->

Switches send the middle one to the controller, too. A set-up message that does not fit it comes
from a host that has not heard the acceptor, and asks for light in the name of another.
"""

from collections import Counter
from dataclasses import dataclass, field

from controller_apps.packets import ACK, RST, FiveTuple, Segment
from controller_apps.sessions.actions import Action, AddBypass, CountBypass, Drop, Forward
from controller_apps.sessions.sessions import Arrival, Request, Sessions
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts, released
from controller_apps.timeouts import COUNTING_S
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH

MAX_HANDSHAKES = 8192
MAX_OF_ONE = 512  # of an opener's address: nobody's place is taken by the connections of another


@dataclass(frozen=True)
class Handshake:
    """An acceptor's answer, where a switch has heard it (datapath id and port)."""

    opener_next: int  # sequence number of the opener's first byte
    acceptor_next: int
    at: tuple[int, int]


@dataclass
class Handshakes:
    _by_connection: dict[FiveTuple, Handshake] = field(default_factory=dict)  # the oldest first
    _of: Counter[str] = field(default_factory=Counter)

    def heard(self, segment: Segment, at: tuple[int, int]) -> None:
        """Note a segment with SYN and ACK from the metadata port."""
        connection = segment.five_tuple.reverse()
        self._forget(connection)
        opener = connection.source
        if self._of[opener] >= MAX_OF_ONE:
            oldest = next(
                five_tuple for five_tuple in self._by_connection if five_tuple.source == opener
            )
            self._forget(oldest)
        elif len(self._by_connection) >= MAX_HANDSHAKES:
            self._forget(next(iter(self._by_connection)))
        acceptor_next = (segment.sequence + 1) & 0xFFFFFFFF
        self._by_connection[connection] = Handshake(segment.acknowledged, acceptor_next, at)
        self._of[opener] += 1

    def completed_by(self, segment: Segment, at: tuple[int, int]) -> bool:
        """Return whether a segment is the first with data of a connection that has begun.

        It has to come by another port than the acceptor's answer.
        """
        handshake = self._by_connection.get(segment.five_tuple)
        return handshake is not None and (segment.sequence, segment.acknowledged, True) == (
            handshake.opener_next,
            handshake.acceptor_next,
            at != handshake.at,
        )

    def _forget(self, connection: FiveTuple) -> None:
        if self._by_connection.pop(connection, None) is not None:
            self._of[connection.source] -= 1
            if not self._of[connection.source]:
                del self._of[connection.source]


WINDOW = 1 << 20  # bytes further on than was seen


@dataclass
class Connections:
    sessions: Sessions
    terms: Terms
    verdicts: Verdicts

    def repeated(self, request: Request, arrival: Arrival) -> list[Action]:
        """Answer a copy of a set-up message that was answered before."""
        message = arrival.segment.payload[:SETUP_LENGTH]
        if message not in (request.message, request.answer):
            detail = "another set-up message under the same sequence number"
            return [Drop("forged", detail, arrival.port)]
        if request.held is not None:
            return [Drop("repeated", "the set-up message is held already", arrival.port)]
        # The answer itself arrives here if a second switch is on the path.
        return [released(request, arrival)]

    def data(self, request: Request, arrival: Arrival, now: float) -> list[Action]:
        """Pass data behind the set-up message; more of it passes by a bypass."""
        offset = request.offset(arrival.segment.sequence)
        if request.held is not None or offset < SETUP_LENGTH:
            return [Drop("early", "data before the set-up message was answered", arrival.port)]
        if offset <= request.progress + WINDOW:
            request.heard(arrival.segment)
        forward = Forward(arrival.dpid, arrival.in_port, arrival.segment.frame)
        session = self.sessions.of(request)
        if session is None:
            return [forward]
        session.heard(now)
        if not request.lasts or arrival.dpid in request.bypassed:
            return [forward]
        # Not earlier: a repeated set-up message must reach the controller until data follows.
        request.bypassed.add(arrival.dpid)
        return [AddBypass(arrival.dpid, request.five_tuple, session.number), forward]

    def closed(self, segment: Segment, now: float) -> list[Action]:
        """End the request of a connection if a FIN or RST is genuine; count bytes if in doubt."""
        from_opener = segment.five_tuple.destination_port == METADATA_PORT
        opener = segment.five_tuple if from_opener else segment.five_tuple.reverse()
        request = self.sessions.requests.get(opener)
        if request is None:
            return []
        is_checked = self.terms.policy.filter.sequences
        if not is_checked or is_expected(request, segment, from_opener):
            return self.verdicts.over(request, "RST" if segment.flags & RST else "FIN", now)
        at = position(request, segment, from_opener)
        if request.bypassed and request.doubted is None and at is not None and at >= 0:
            request.doubted = at, now
            return _count(request)
        return []  # of an earlier connection between the same ports, or a guess

    def counted(self, five_tuple: FiveTuple, count: int, now: float) -> list[Action]:
        """Believe a doubted close if the switch has counted as many bytes, headers included.

        The count lags behind: a low one is asked for again COUNTING_S later.
        """
        request = self.sessions.requests.get(five_tuple)
        if request is None or request.doubted is None:
            return []
        at, since = request.doubted
        if at <= request.progress + count + WINDOW:
            request.doubted = None
            return self.verdicts.over(request, "close", now)
        if now - since >= COUNTING_S:
            request.doubted = None  # a guess
        return []

    def count_again(self, now: float) -> list[Action]:
        """Ask for the bytes of connections with a doubted close."""
        return [
            action
            for session in self.sessions.by_number.values()
            for request in session.requests.values()
            if request.doubted is not None and now - request.doubted[1] >= COUNTING_S
            for action in _count(request)
        ]


def _count(request: Request) -> list[Action]:
    dpids = sorted(request.bypassed)[:1]
    return [CountBypass(dpid, request.five_tuple, request.setup.session) for dpid in dpids]


def is_expected(request: Request, segment: Segment, from_opener: bool) -> bool:
    """Return whether a closing segment fits the sequence numbers seen of both ends."""
    at = position(request, segment, from_opener)
    if at is None:  # it shows the acceptor's alone
        return request.acceptor_next is None or segment.sequence == request.acceptor_next
    if not 0 <= at <= request.progress + WINDOW:
        return False
    if not segment.flags & ACK:
        return request.acceptor_next is None or at == request.progress
    acceptor = segment.acknowledged if from_opener else segment.sequence
    return request.acceptor_next is None or (acceptor - request.acceptor_next) % (1 << 32) <= WINDOW


def position(request: Request, segment: Segment, from_opener: bool) -> int | None:
    """Return the opener's position by a segment, in bytes from the beginning of its message.

    None if a segment of the acceptor acknowledges nothing.
    """
    if from_opener:
        return request.offset(segment.sequence)
    return request.offset(segment.acknowledged) if segment.flags & ACK else None
