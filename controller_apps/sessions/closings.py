"""Whether a FIN or RST is of the connection that it names, by the sequence numbers seen of it.

Who cannot see a connection can only guess where it is. What goes past the controller by a bypass
it does not see: a close further on than it has seen is held against the bytes that the switch has
counted there.
"""

from controller_apps.packets.segments import ACK, Segment
from controller_apps.sessions.sessions import Request

WINDOW = 1 << 20  # bytes further on than was seen


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
