"""Arrays of small numbers as they travel between the ends of a session (wire.metadata.Values)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hosts.middleware.session.errors import SAME_VERSION, SessionError
from wire.metadata import Reason, Topic, Values

Numbers = NDArray[np.uint32]


def values(session: int, topic: int, block: int, numbers: ArrayLike, width: int) -> Values:
    """Return the message that carries numbers of so many bits (1, 2, 8 or 32), without gaps."""
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
    """Return the numbers of a message that must be about this, of so many, none above `most`.

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
    known = {each.value: each.name for each in Topic}
    return f"{topic} ({known[topic]})" if topic in known else str(topic)
