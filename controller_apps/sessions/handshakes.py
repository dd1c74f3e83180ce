"""TCP connections to the metadata port that have begun, by the answers of their acceptors.

    opener --SYN, seq a-->              <--SYN ACK, seq b, ack a+1-- acceptor
           --set-up, seq a+1, ack b+1-->

Switches send the middle one to the controller, too. A set-up message that does not fit it comes
from a host that has not heard the acceptor, and asks for light in the name of another.
"""

from collections import Counter
from dataclasses import dataclass, field

from controller_apps.packets.segments import FiveTuple, Segment

MAX_HANDSHAKES = 8192
MAX_OF_ONE = 512  # of an opener's address: nobody's place is taken by the connections of another


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
