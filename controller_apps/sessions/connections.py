"""The decision on a segment of a connection whose set-up is known: pass, drop, or end its request.

A FIN or RST is believed if it fits the sequence numbers that the controller has seen. Data that
passes by a bypass it does not see: then a close further on is compared with the bytes that the
switch has counted, and somebody who cannot see the connection can only guess.
"""

from dataclasses import dataclass

from controller_apps.packets.segments import ACK, RST, FiveTuple, Segment
from controller_apps.sessions.actions import Action, AddBypass, CountBypass, Drop, Forward
from controller_apps.sessions.sessions import Arrival, Request, Sessions
from controller_apps.sessions.terms import Terms
from controller_apps.sessions.verdicts import Verdicts, released
from controller_apps.timeouts import COUNTING_S
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH

WINDOW = 1 << 20  # bytes further on than was seen


@dataclass
class Connections:
    """Follows the connections of all requests."""

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
