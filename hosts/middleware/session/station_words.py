"""The messages of a station about a block that it was asked to herald, and how they are read.

opener                                station
  | Emit(block, pairs) ---------------> |  heralds until it has as many, or its time is over
  | <----------------------- Answer(OK) |
  | <------- Values(COUNTS): attempts   |  high and low 32 bits
  | <------- Values(HERALDED): n states |
"""

from hosts.hardware.qnic import Heralds
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import expect, values
from wire.metadata import Answer, Reason, Topic, Values

WORD = 32  # bits
MAX_WORD = (1 << WORD) - 1
MAX_STATE = 3


def words_of(session: int, block: int, heralds: Heralds) -> tuple[Answer, Values, Values]:
    """Return what tells the opener what has been heralded of a block."""
    counts = [heralds.attempts >> WORD, heralds.attempts & MAX_WORD]
    return (
        Answer(session, Reason.OK),
        values(session, Topic.COUNTS, block, counts, WORD),
        values(session, Topic.HERALDED, block, heralds.states, 2),
    )


def heralds_of(counts: Values, told: Values, block: int, most: int) -> Heralds:
    """Return what a station tells behind its answer; SessionError for more pairs than that."""
    high, low = expect(counts, Topic.COUNTS, block, 2, MAX_WORD).tolist()
    states = expect(told, Topic.HERALDED, block, None, MAX_STATE).astype("u1")
    if states.size > most:
        text = f"{states.size} pairs of block {block} heralded, {most} were asked for"
        raise SessionError(Reason.PROTOCOL, text)
    return Heralds(states, (high << WORD) + low)
