"""TCP connections to the metadata port that have begun, by what their acceptors said to it.

    opener --SYN, seq a-->              <--SYN ACK, seq b, ack a+1-- acceptor
           --set-up, seq a+1, ack b+1-->

Switches send the middle one to the controller, too. A set-up message that does not fit it comes
from somebody who has not heard the acceptor: nothing is asked for in the name of another.

Whether a FIN or RST is of the connection that it names, by the sequence numbers seen of it.

Who cannot see a connection can only guess where it is. What goes past the controller by a bypass
it does not see: a close further on than it has seen is held against the bytes that the switch has
counted there.
"""

from collections import Counter
from dataclasses import dataclass, field

from controller_apps.packets.segments import ACK, FiveTuple, Segment
from controller_apps.sessions.sessions import Request

MAX_HANDSHAKES = 8192
MAX_OF_ONE = 512  # of an opener's address: nobody's place is taken by the connections of another
WINDOW = 1 << 20  # bytes further on than was seen


@dataclass(frozen=True)
class Handshake:
    """What an acceptor has answered, where a switch has heard it (datapath id and port)."""

    opener_next: int  # sequence number of the opener's first byte
    acceptor_next: int
    at: tuple[int, int]


@dataclass
class Handshakes:
    """The last handshake of each connection, of so many connections."""

    _by_connection: dict[FiveTuple, Handshake] = field(default_factory=dict)  # the oldest first
    _of: Counter[str] = field(default_factory=Counter)

    def heard(self, segment: Segment, at: tuple[int, int]) -> None:
        """Note a segment with SYN and ACK from the metadata port."""
        connection = segment.five_tuple.reverse()
        self._forget(connection)
        opener = connection.source
        if self._of[opener] >= MAX_OF_ONE:
            self._forget(next(known for known in self._by_connection if known.source == opener))
        elif len(self._by_connection) >= MAX_HANDSHAKES:
            self._forget(next(iter(self._by_connection)))
        acceptor_next = (segment.sequence + 1) & 0xFFFFFFFF
        self._by_connection[connection] = Handshake(segment.acknowledged, acceptor_next, at)
        self._of[opener] += 1

    def completed_by(self, segment: Segment, at: tuple[int, int]) -> bool:
        """Tell whether a segment is the first with data of a connection that has begun.

        Who speaks for both ends does so by way of one port.
        """
        known = self._by_connection.get(segment.five_tuple)
        told = segment.sequence, segment.acknowledged
        return (
            known is not None
            and at != known.at
            and told
            == (
                known.opener_next,
                known.acceptor_next,
            )
        )

    def _forget(self, connection: FiveTuple) -> None:
        if self._by_connection.pop(connection, None) is not None:
            self._of[connection.source] -= 1
            if not self._of[connection.source]:
                del self._of[connection.source]


def is_expected(request: Request, segment: Segment, from_opener: bool) -> bool:
    """Tell whether a closing segment fits what was seen of both ends."""
    at = position(request, segment, from_opener)
    if at is None:  # it tells of the acceptor alone
        return request.acceptor_next is None or segment.sequence == request.acceptor_next
    if not 0 <= at <= request.progress + WINDOW:
        return False
    if not segment.flags & ACK:
        return request.acceptor_next is None or at == request.progress
    acceptor = segment.acknowledged if from_opener else segment.sequence
    return request.acceptor_next is None or (acceptor - request.acceptor_next) % (1 << 32) <= WINDOW


def position(request: Request, segment: Segment, from_opener: bool) -> int | None:
    """Return where the opener is as a segment has it, in bytes from the beginning of its message.

    None if a segment of the acceptor does not say so.
    """
    if from_opener:
        return request.offset(segment.sequence)
    return request.offset(segment.acknowledged) if segment.flags & ACK else None
