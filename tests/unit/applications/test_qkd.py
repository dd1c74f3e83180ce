"""Messages of key distribution: golden bytes both ways, every truncation, what is refused."""

import random
import struct

import numpy as np
import pytest

from applications.qkd.messages import (
    HEADER,
    KINDS,
    MAX_KEY_BITS,
    MAX_LENGTH,
    MAX_PHOTONS,
    MAX_PULSES,
    TAG_BYTES,
    Abort,
    AbortReason,
    Amplify,
    AskBlocks,
    AskIntervals,
    AskSyndrome,
    BellAnswer,
    BellTest,
    Bound,
    Confirm,
    Detections,
    Disclosed,
    Intensities,
    Parities,
    Proposal,
    QkdMessage,
    Reconciliation,
    Sample,
    Sifted,
    Verify,
    message_length,
    unframe,
    unsealed,
)
from wire import gaps
from wire.malformed import MalformedPacket

SESSION, SEQUENCE = 0x0102030405060708, 9
TAG = bytes(range(16))
SEED = b"\x5a" * 32
SEEN = b"\x00\x00\x00\x00\x0a\xc0\x40"  # 0, 1 and 9

GOLDEN: list[tuple[QkdMessage, str]] = [
    (
        Proposal(
            0.5, 0.25, 0.125, 0.0625, Bound.FINITE, Reconciliation.CASCADE, 0.03125, 0.25, 0.5
        ),
        "514b01010000005e010203040506070800000009"
        "3fe0000000000000 3fd0000000000000 3fc0000000000000 3fb0000000000000 01 01"
        "3fa0000000000000 3fd0000000000000 3fe0000000000000",
    ),
    (
        Detections(1, 10, 3, 7, b"\x00\x00\x00\x00\x0a\xc0\x40", b"\xa0"),
        "514b01020000003c0102030405060708000000 09 00000001 0000000a 00000003 00000007"
        "00 0000000a c040 a0",
    ),
    (Sifted(1, 3, b"\x60"), "514b01030000002d010203040506070800000009 00000001 00000003 60"),
    (
        Sample(100, 9, SEED, b"\xff\x80"),
        "514b01040000004e010203040506070800000009 00000064 00000009" + SEED.hex() + "ff80",
    ),
    (Disclosed(9, b"\xfe\x00"), "514b01050000002a010203040506070800000009 00000009 fe00"),
    (Parities(0, b""), "514b010600000028010203040506070800000009 00000000"),
    (AskBlocks(3, 11, 8192), "514b01070000002a010203040506070800000009 03 0b 00002000"),
    (
        AskIntervals(2, 1, b"\x00\x00\x10\x00", b"\x00\x20"),
        "514b01080000002f010203040506070800000009 02 00000001 00001000 0020",
    ),
    (
        BellTest(2, 9, b"\x81\x80", b"\x40", b"\xa0"),
        "514b010f00000030010203040506070800000009 00000002 00000009 8180 40 a0",
    ),
    (
        BellAnswer(2, 3, b"\xc0", b"\x80", b"\x40"),
        "514b01100000002f010203040506070800000009 00000002 00000003 c0 80 40",
    ),
    (AskSyndrome(500), "514b010900000028010203040506070800000009 000001f4"),
    (
        Verify(SEED, TAG, 238, 30),
        "514b010a0000005c010203040506070800000009" + SEED.hex() + TAG.hex() + "000000ee 0000001e",
    ),
    (
        Amplify(786, 12, b"\xab\xc0"),
        "514b010b0000002e010203040506070800000009 00000312 0000000c abc0",
    ),
    (
        Intensities(0.5, 0.25, 0.125, 0.5, 0.25, 0.25, 5, b"\x18\x40"),
        "514b010e0000005a010203040506070800000009"
        "3fe0000000000000 3fd0000000000000 3fc0000000000000"
        "3fe0000000000000 3fd0000000000000 3fd0000000000000 00000005 1840",
    ),
    (Confirm(786), "514b010c00000028010203040506070800000009 00000312"),
    (
        Abort(AbortReason.NOISY, "zu laut"),
        "514b010d0000002c010203040506070800000009 05 7a75206c617574",
    ),
]


def whole(message: QkdMessage) -> bytes:
    return unsealed(message, SESSION, SEQUENCE) + TAG


def test_every_kind_has_golden_bytes() -> None:
    assert {type(message) for message, _golden in GOLDEN} == set(KINDS.values())


@pytest.mark.parametrize(("message", "golden"), GOLDEN)
def test_golden_bytes_both_ways(message: QkdMessage, golden: str) -> None:
    data = bytes.fromhex(golden.replace(" ", "")) + TAG
    assert whole(message).hex() == data.hex()
    sealed = unframe(data)
    assert (sealed.session, sealed.sequence, sealed.tag) == (SESSION, SEQUENCE, TAG)
    assert sealed.covered + sealed.tag == data
    assert sealed.open() == message


@pytest.mark.parametrize(("message", "_golden"), GOLDEN)
def test_a_body_of_another_length_is_malformed(message: QkdMessage, _golden: str) -> None:
    body = message.encode()
    if isinstance(message, Abort):
        return
    for wrong in (body[:-1], body + b"\0"):
        with pytest.raises(MalformedPacket):
            type(message).parse(wrong)


HEADERS = [
    (0x514D, 1, 1, 70, "not key distribution"),
    (0x514B, 2, 1, 70, "version 2"),
    (0x514B, 1, 0, 70, "unknown kind 0"),
    (0x514B, 1, 17, 70, "unknown kind 17"),
    (0x514B, 1, 1, HEADER.size + TAG_BYTES - 1, "bytes in a message"),
    (0x514B, 1, 1, MAX_LENGTH + 1, "bytes in a message"),
]


@pytest.mark.parametrize(("magic", "version", "kind", "length", "says"), HEADERS)
def test_a_wrong_header_is_refused_at_once(
    magic: int, version: int, kind: int, length: int, says: str
) -> None:
    with pytest.raises(MalformedPacket, match=says):
        message_length(HEADER.pack(magic, version, kind, length, SESSION, SEQUENCE))


WRONG: list[QkdMessage] = [
    Proposal(0.0, 0.1, 0.1, 0.1, 1, 1, 0.0, 0.0, 0.0),
    Proposal(0.1, 1.0, 0.1, 0.1, 1, 1, 0.0, 0.0, 0.0),
    Proposal(0.1, 0.1, float("nan"), 0.1, 1, 1, 0.0, 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, float("inf"), 1, 1, 0.0, 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 3, 1, 0.0, 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 0, 0.0, 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 1, 1.0, 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 1, -0.1, 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 1, float("nan"), 0.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 1, 0.0, 1.0, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 1, 0.0, -0.1, 0.0),
    Proposal(0.1, 0.1, 0.1, 0.1, 1, 1, 0.0, 0.0, float("nan")),
    Intensities(0.5, 0.25, 0.25, 0.5, 0.25, 0.25, 1, b"\x00"),  # decoys alike
    Intensities(0.5, 0.4, 0.2, 0.5, 0.25, 0.25, 1, b"\x00"),
    Intensities(0.5, 0.25, -0.1, 0.5, 0.25, 0.25, 1, b"\x00"),
    Intensities(11.0, 0.25, 0.0, 0.5, 0.25, 0.25, 1, b"\x00"),
    Intensities(float("nan"), 0.25, 0.0, 0.5, 0.25, 0.25, 1, b"\x00"),
    Intensities(0.5, 0.25, 0.0, 0.5, 0.25, 0.2, 1, b"\x00"),
    Intensities(0.5, 0.25, 0.0, 0.5, 0.5, 0.0, 1, b"\x00"),
    Intensities(0.5, 0.25, 0.0, 0.5, 0.25, 0.25, 1, b"\xc0"),  # level 3
    Intensities(0.5, 0.25, 0.0, 0.5, 0.25, 0.25, 1, b"\x08"),  # padding
    Intensities(0.5, 0.25, 0.0, 0.5, 0.25, 0.25, 0, b""),
    Detections(0, 0, 0, 0, b"", b""),
    Detections(0, MAX_PULSES, MAX_PHOTONS + 1, 0, b"", b""),
    Detections(0, 10, 3, 7, SEEN, b"\x10"),
    Detections(0, 10, 3, 8, SEEN, b"\xa0"),
    Sifted(0, 3, b"\x10"),
    Sifted(0, MAX_PHOTONS + 1, b""),
    Sample(100, 0, SEED, b""),
    Sample(9, 9, SEED, b"\xff\x80"),
    Sample(MAX_KEY_BITS + 1, 9, SEED, b"\xff\x80"),
    Disclosed(MAX_KEY_BITS + 1, b""),
    Parities(9, b"\xff\x81"),
    AskIntervals(0, 0, b"", b""),
    AskIntervals(0, 2, bytes(4), bytes(2)),
    Amplify(0, 8, b"\0"),
    Amplify(MAX_KEY_BITS + 1, 8, b"\0"),
    Amplify(1, 2 * MAX_KEY_BITS + 1, b""),
    Abort(0),
    Abort(99),
]


@pytest.mark.parametrize("message", WRONG)
def test_fields_that_cannot_be_are_malformed(message: QkdMessage) -> None:
    with pytest.raises(MalformedPacket):
        type(message).parse(message.encode())


def test_the_text_of_an_abort_is_utf8_and_bounded() -> None:
    with pytest.raises(MalformedPacket, match="UTF-8"):
        Abort.parse(b"\x05\xff")
    with pytest.raises(MalformedPacket, match="bytes of text"):
        Abort.parse(b"\x05" + b"x" * 1001)
    assert Abort.parse(Abort(AbortReason.NOISY, "ä" * 600).encode()) == Abort(5, "ä" * 500)


@pytest.mark.parametrize(
    "message",
    [
        Detections(0, 10, 3, 7, b"\x00\x00\x00\x00\x0a\xc0\x41", b"\xa0"),  # padding
        Detections(0, 10, 2, 7, SEEN, b"\x80"),  # three have clicked
        Detections(0, 9, 3, 7, SEEN, b"\xa0"),  # the tenth of nine
    ],
)
def test_gaps_that_cannot_be_are_malformed(message: Detections) -> None:
    with pytest.raises(MalformedPacket, match="Detections"):
        _ = message.clicked
    assert Detections(0, 10, 3, 7, SEEN, b"\xa0").clicked.tolist() == [0, 1, 9]


def test_the_largest_messages_fit() -> None:
    rng = random.Random(2)
    drawn = np.unique(np.random.default_rng(2).integers(0, MAX_PULSES, MAX_PHOTONS + 1000))
    seen = gaps.encode(drawn[:MAX_PHOTONS])  # some 120 were drawn twice
    blocks = MAX_KEY_BITS // 4  # cascade's shortest blocks
    largest: list[QkdMessage] = [
        Detections(0, MAX_PULSES, MAX_PHOTONS, len(seen), seen, rng.randbytes(MAX_PHOTONS // 8)),
        AskIntervals(0, blocks, bytes(4 * blocks), bytes(2 * blocks)),
        Amplify(MAX_KEY_BITS, 2 * MAX_KEY_BITS, rng.randbytes(MAX_KEY_BITS // 4)),
    ]
    for message in largest:
        assert unframe(whole(message)).open() == message


def test_a_message_that_is_too_long_cannot_be_sent() -> None:
    with pytest.raises(ValueError, match=f"at most {MAX_LENGTH}"):
        whole(AskIntervals(0, MAX_KEY_BITS, bytes(4 * MAX_KEY_BITS), bytes(2 * MAX_KEY_BITS)))


def test_a_length_that_lies_about_its_message_is_malformed() -> None:
    data = bytearray(whole(Confirm(1)))
    struct.pack_into("!I", data, 4, len(data) + 1)
    with pytest.raises(MalformedPacket):
        unframe(bytes(data))
