"""Values as they travel between the ends of a session (wire.metadata.values.Values).

Arrays of small numbers, and the lifetimes of a memory.

A relay that was asked for what it has measured answers Values(ARRIVED), of which pairs of pulses it
has a Bell state to tell, and Values(OUTCOMES), these states.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hosts.hardware.replies import Symbols
from hosts.middleware.session.errors import SAME_VERSION, SessionError
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason
from wire.outcomes import NO_COINCIDENCE

Numbers = NDArray[np.uint32]
MAX_WORD = (1 << 32) - 1
MAX_STATE = 3
NUMBERS = 4  # that lifetimes travel as


def values(session: int, topic: int, block: int, numbers: ArrayLike, width: int) -> Values:
    """Return the message that carries numbers of `width` bits (1, 2, 8 or 32), without gaps."""
    array = np.asarray(numbers)
    if width == 32:
        data = array.astype(">u4").tobytes()
    elif width == 8:
        data = array.astype(np.uint8).tobytes()
    else:
        bits = np.empty((array.size, width), dtype=np.uint8)
        for place in range(width):
            bits[:, place] = array.astype(np.uint8) >> (width - 1 - place) & 1
        data = np.packbits(bits).tobytes()
    return Values(session, topic, width, block, array.size, data)


def numbers_of(message: Values) -> Numbers:
    """Return what a message carries; shape (count,)."""
    if message.width == 32:
        return np.frombuffer(message.data, ">u4").astype(np.uint32)
    if message.width == 8:
        return np.frombuffer(message.data, np.uint8).astype(np.uint32)
    size = message.count * message.width
    bits = np.unpackbits(np.frombuffer(message.data, np.uint8), count=size)
    numbers: Numbers = bits[:: message.width].astype(np.uint32)
    for place in range(1, message.width):
        numbers = numbers << np.uint32(1) | bits[place :: message.width]
    return numbers


def expect(message: Values, topic: int, block: int, count: int | None, most: int) -> Numbers:
    """Return the numbers of a message of this topic and size, none above `most`.

    Raise SessionError if it is not; count None: any number of them.
    """
    if (message.topic, message.block) != (topic, block):
        raise SessionError(
            Reason.PROTOCOL,
            f"values of topic {_named(message.topic)} and block {message.block} came where "
            f"{_named(topic)} and {block} were due; {SAME_VERSION}",
        )
    numbers = numbers_of(message)
    if count is not None and numbers.size != count:
        raise SessionError(
            Reason.PROTOCOL, f"{numbers.size} values of topic {topic}, {count} were expected"
        )
    if numbers.size and numbers.max() > most:
        raise SessionError(
            Reason.PROTOCOL, f"a value of topic {topic} is {numbers.max()}, at most {most} is known"
        )
    return numbers


def _named(topic: int) -> str:
    names = {each.value: each.name for each in Topic}
    return f"{topic} ({names[topic]})" if topic in names else str(topic)


def announcement(session: int, block: int, outcomes: Symbols) -> tuple[Values, Values]:
    seen = outcomes != NO_COINCIDENCE
    return (
        values(session, Topic.ARRIVED, block, seen, 1),
        values(session, Topic.OUTCOMES, block, outcomes[seen], 2),
    )


def announced(arrived: Values, reply: Values, block: int, pulses: int) -> Symbols:
    """Return what a relay has found; SessionError for what it cannot have."""
    seen = expect(arrived, Topic.ARRIVED, block, pulses, 1).astype(bool)
    outcomes = np.full(pulses, NO_COINCIDENCE, dtype=np.uint8)
    states = expect(reply, Topic.OUTCOMES, block, int(np.count_nonzero(seen)), MAX_STATE)
    outcomes[seen] = states
    return outcomes


class Lifetimes(NamedTuple):
    """T1, T2, the time of depolarising, and the cut-off, in seconds; infinite: there is none."""

    t1_s: float
    t2_s: float
    depolarizing_s: float
    cutoff_s: float  # what is older is dropped

    def numbers(self) -> list[int]:
        """Return them as whole numbers of 32 bits: IEEE 754, single precision."""
        return [int(bits) for bits in np.array(self, np.float32).view(np.uint32)]

    @classmethod
    def of(cls, numbers: list[int], peer: str) -> "Lifetimes":
        """Return the lifetimes that another end reports; SessionError for impossible ones."""
        times = cls(*np.array(numbers, np.uint32).view(np.float32).tolist())
        if not all(time_s > 0 for time_s in times):  # also what is not a number
            text = ", ".join(f"{name} {value}" for name, value in times._asdict().items())
            raise SessionError(Reason.PROTOCOL, f"{peer} has a memory with {text}")
        return times
