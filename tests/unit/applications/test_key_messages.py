"""Messages of key distribution on their way through envelopes, which cut them anywhere."""

import random

import numpy as np
import pytest

from applications.key_distribution.under_way import Cutter, in_envelopes
from applications.qkd.messages import (
    TAG_BYTES,
    Abort,
    AbortReason,
    AskSyndrome,
    Confirm,
    Detections,
    QkdMessage,
    unframe,
    unsealed,
)
from wire import gaps
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.header import MAX_LENGTH
from wire.metadata.values import Topic

SESSION = 0x0102030405060708


def whole(sequence: int, message: QkdMessage) -> bytes:
    """Return a message as it travels; nobody looks at its tag here."""
    return unsealed(message, SESSION, sequence) + bytes([sequence]) * TAG_BYTES


def detections(photons: int) -> QkdMessage:
    """Return a message of two bits for each photon, all of which were seen."""
    bits = random.Random(1).randbytes(photons // 8)
    seen = gaps.encode(np.arange(photons))
    return Detections(1, photons, photons, len(seen), seen, bits)


MESSAGES = [
    whole(number, message)
    for number, message in enumerate(
        [
            Confirm(786),  # a body of four bytes
            Detections(1, 10, 3, 7, gaps.encode(np.array([0, 1, 9])), b"\xa0"),
            Abort(AbortReason.NOISY, ""),  # nearly none
            AskSyndrome(500),
        ]
    )
]


def test_messages_may_be_cut_at_every_position() -> None:
    stream = b"".join(MESSAGES)
    for place in range(len(stream) + 1):
        cutter = Cutter()
        before = [*cutter.feed(stream[:place])]
        lengths = [len(b"".join(MESSAGES[:count])) for count in range(len(MESSAGES) + 1)]
        assert len(before) == max(count for count, size in enumerate(lengths) if size <= place)
        assert [*before, *cutter.feed(stream[place:])] == MESSAGES


def test_messages_may_come_byte_by_byte() -> None:
    cutter = Cutter()
    stream = b"".join(MESSAGES)
    found = [message for byte in stream for message in cutter.feed(bytes([byte]))]
    assert found == MESSAGES


@pytest.mark.parametrize("photons", [200_000, 240_000, 1_000_000])
def test_what_is_longer_than_a_piece_travels_in_several_envelopes(photons: int) -> None:
    """Of 200,000 photons there are 25,000 bytes of places and as many of bits."""
    long = whole(9, detections(photons))
    assert len(long) > 2 * photons // 8
    envelopes = [*in_envelopes(SESSION, [MESSAGES[0], long, MESSAGES[1]])]
    cutter, found = Cutter(), list[bytes]()
    for envelope in envelopes:
        data = envelope.encode()
        assert len(data) <= MAX_LENGTH
        assert decode(data) == envelope
        assert (envelope.session, envelope.topic) == (SESSION, Topic.KEYS)
        found += cutter.feed(envelope.content)
    assert found == [MESSAGES[0], long, MESSAGES[1]]
    assert unframe(found[1]).open() == detections(photons)


def test_what_cannot_be_a_message_is_refused_as_soon_as_that_is_known() -> None:
    cutter = Cutter()
    assert [*cutter.feed(MESSAGES[0])] == [MESSAGES[0]]
    with pytest.raises(MalformedPacket):
        list(cutter.feed(b"GET / HTTP/1.1\r\nHost: bob\r\n\r\n"))
