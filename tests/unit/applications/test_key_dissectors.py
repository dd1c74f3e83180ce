"""Messages of services within quantum metadata, as tshark shows them."""

import random
import struct
from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dissection import found, segment, shown, tshark
from dissector_scene import SEED, SETUP, mutated, plain
from test_qkd import GOLDEN, SEQUENCE, SESSION, TAG, WRONG, whole

from applications.qkd.dissection import key_layouts
from applications.qkd.messages import (
    HEADER,
    MAX_TEXT,
    Abort,
    AbortReason,
    AskIntervals,
    Detections,
    QkdMessage,
    message_length,
    unframe,
)
from views.dissection.layout import Layout
from wire import gaps
from wire.malformed import MalformedPacket
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.values import Envelope, Topic, Values

MESSAGES = [
    *(message for message, _golden in GOLDEN),
    Detections(2, 800, 800, 105, gaps.encode(np.arange(800)), b"\xa5" * 100),
    Abort(AbortReason.CANCELLED),
    Abort(AbortReason.NOISY, "ä" * (MAX_TEXT // 2)),
]
LAYOUTS: dict[int, Layout] = {layout.number: layout for layout in key_layouts()}
CONSTANT = {"session": SESSION, "sequence": SEQUENCE, "authentication": TAG.hex()}


def envelope(content: bytes) -> bytes:
    """Return what travels of a stream of messages, or of a part of it."""
    return Envelope(SESSION, Topic.KEYS, content).encode()


def alone(contents: list[bytes]) -> list[bytes]:
    """Return frames that carry each of these on a connection of its own."""
    return [segment(envelope(content), number) for number, content in enumerate(contents)]


def expected(message: QkdMessage) -> dict[str, Any]:
    """Return what tshark shall show of a message, from its attributes alone."""
    values: dict[str, Any] = dict(CONSTANT)
    for item in fields(message):
        value = getattr(message, item.name)
        values[item.name] = value.hex() if isinstance(value, bytes) else value
    return {f"qkd.{name}": value for name, value in values.items() if value != ""}


def as_shown(text: str, want: Any) -> Any:
    if isinstance(want, float):
        return float(text)
    return text if isinstance(want, str) else plain(text)


def test_every_field_of_every_message_is_shown(tmp_path: Path) -> None:
    assert {type(message) for message in MESSAGES} == {type(message) for message, _ in GOLDEN}
    wanted = [expected(message) for message in MESSAGES]
    names = sorted({name for row in wanted for name in row})
    rows = shown(tmp_path, alone([whole(message) for message in MESSAGES]), names)
    for row, want in zip(rows, wanted, strict=True):
        seen = {name: as_shown(values[0], want.get(name)) for name, values in row.items() if values}
        assert seen == want
        assert all(len(values) <= 1 for values in row.values())


FILTERS = {
    "qkd": len(MESSAGES),
    'qkd.kind == "Detections"': 2,
    'qkd.bound == "FINITE"': 1,
    'qkd.reason == "NOISY"': 2,
    "qkd.max_qber < 0.3": 1,
    "qkd.aborted": 3,
    'qmeta.topic == "KEYS" && !qkd.malformed': len(MESSAGES),
}


@pytest.fixture(scope="module")
def counts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, int]:
    """Return how many messages each filter finds; one tshark says it of all."""
    frames = alone([whole(message) for message in MESSAGES])
    folder = tmp_path_factory.mktemp("filters")
    return dict(zip(FILTERS, found(folder, frames, list(FILTERS)), strict=True))


@pytest.mark.parametrize("expression", list(FILTERS))
def test_filters_find_messages(counts: dict[str, int], expression: str) -> None:
    assert counts[expression] == FILTERS[expression]


def cut(draw: random.Random, stream: bytes, times: int) -> Iterator[bytes]:
    """Yield a stream in pieces, cut anywhere."""
    cuts = sorted({0, len(stream), *(draw.randrange(len(stream)) for _ in range(times))})
    for start, end in pairwise(cuts):
        yield stream[start:end]


def test_messages_are_put_together_across_envelopes_in_both_directions(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    large = AskIntervals(1, 50_000, bytes(200_000), bytes(100_000))
    messages = {False: [*MESSAGES, large, *MESSAGES], True: MESSAGES[::-1]}
    pieces = [
        (answers, piece)
        for answers, stream in messages.items()
        for piece in cut(draw, b"".join(map(whole, stream)), 40)
    ]
    order = sorted(pieces, key=lambda piece: draw.random())
    turn = {way: iter([piece for other, piece in pieces if other == way]) for way in messages}
    frames, places = [segment(SETUP.encode())], {False: 1 + len(SETUP.encode()), True: 1}
    ways = [False]
    for answers, _piece in order:
        rest = envelope(next(turn[answers]))
        while rest:
            data, rest = rest[:60_000], rest[60_000:]
            frames.append(segment(data, seq=places[answers], answer=answers))
            places[answers] += len(data)
            ways.append(answers)
    rows = shown(tmp_path, frames, ["qkd.kind", "qkd.malformed"])
    assert not any(row["qkd.malformed"] for row in rows)
    for way, stream in messages.items():
        kinds = [
            int(kind)
            for answers, row in zip(ways, rows, strict=True)
            for kind in row["qkd.kind"]
            if answers == way
        ]
        assert kinds == [message.KIND for message in stream]


def test_what_one_connection_left_unfinished_does_not_spoil_the_next(tmp_path: Path) -> None:
    half, message = whole(MESSAGES[0])[:30], whole(MESSAGES[1])
    frames, place = [], 1
    for data in (SETUP.encode(), envelope(half), SETUP.encode(), envelope(message)):
        frames.append(segment(data, seq=place))
        place += len(data)
    rows = shown(tmp_path, frames, ["qkd.kind", "qkd.malformed"])
    assert [row["qkd.kind"] for row in rows] == [[], [], [], ["2"]]
    assert not any(row["qkd.malformed"] for row in rows)


def test_a_copy_on_a_further_link_is_not_taken_for_more_of_the_stream(tmp_path: Path) -> None:
    whole_one = whole(MESSAGES[1])
    first, second = envelope(whole_one[:25]), envelope(whole_one[25:])
    frames = [segment(first), segment(first), segment(second, seq=1 + len(first))]
    rows = shown(tmp_path, [*frames, frames[-1]], ["qkd.kind", "qkd.malformed"])
    assert [row["qkd.kind"] for row in rows] == [[], [], ["2"], []]
    assert not any(row["qkd.malformed"] for row in rows)


def with_right_length(data: bytes) -> bytes:
    """Return a message whose header says how long it is."""
    return data[:4] + len(data).to_bytes(4, "big") + data[8:]


def with_other_values() -> Iterator[bytes]:
    """Yield each message with each of its fixed fields 0, all ones, or another number."""
    for message in MESSAGES:
        for field in LAYOUTS[message.KIND].fields:
            for value in [
                *range(24),
                *(1 << shift for shift in range(5, 8 * min(field.size, 4))),
                (1 << 8 * field.size) - 1,
            ]:
                data = bytearray(whole(message))
                start = HEADER.size + field.offset
                data[start : start + field.size] = (value % (1 << 8 * field.size)).to_bytes(
                    field.size, "big"
                )
                yield bytes(data)


def refused(data: bytes) -> bool:
    """Return whether Python finds one of the messages malformed that bytes begin with."""
    try:
        while data and (length := message_length(data)) is not None and length <= len(data):
            unframe(data[:length]).open()
            data = data[length:]
    except MalformedPacket:
        return True
    return False


@pytest.mark.nightly
def test_what_python_refuses_is_marked_as_malformed_and_nothing_else(tmp_path: Path) -> None:
    draw = random.Random(SEED)
    spoiled = [mutated(draw, whole(draw.choice(MESSAGES))) for _ in range(3000)]
    spoiled += [with_right_length(mutated(draw, whole(draw.choice(MESSAGES)))) for _ in range(2000)]
    spoiled += with_other_values()
    spoiled += [whole(message) for message in WRONG]
    frames = alone(spoiled)
    rows = shown(tmp_path, frames, ["qkd.malformed"], passes=1)
    wanted = [refused(data) for data in spoiled]
    assert 0.2 < sum(wanted) / len(wanted) < 0.8
    wrong = [
        (data.hex(), want)
        for data, row, want in zip(spoiled, rows, wanted, strict=True)
        if bool(row["qkd.malformed"]) != want
    ]
    assert wrong == []


VALUES: list[tuple[int, list[int]]] = [
    (1, [1, 0, 1, 1, 0, 0, 1, 0, 1]),
    (2, [3, 1, 0, 2, 3]),
    (8, [0, 255, 7]),
    (32, [1, (1 << 32) - 1]),
    (2, [1] * 100),
    (1, []),
]


def packed(width: int, numbers: list[int]) -> bytes:
    """Return a message of numbers of this width in bits."""
    bits = "".join(f"{number:0{width}b}" for number in numbers)
    bits += "0" * (-len(bits) % 8)
    data = bytes(int(bits[start : start + 8], 2) for start in range(0, len(bits), 8))
    return Values(1, Topic.COUNTS, width, 3, len(numbers), data).encode()


@pytest.fixture(scope="module")
def values_shown(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, list[str]]]:
    """Return what one tshark shows of all values, each on a connection of its own."""
    frames = [segment(packed(*values), number) for number, values in enumerate(VALUES)]
    folder = tmp_path_factory.mktemp("values")
    return shown(folder, frames, ["qmeta.value", "qmeta.malformed"])


@pytest.mark.parametrize("number", range(len(VALUES)))
def test_values_are_shown_one_by_one(values_shown: list[dict[str, list[str]]], number: int) -> None:
    row, (_width, numbers) = values_shown[number], VALUES[number]
    assert [int(text) for text in row["qmeta.value"]] == numbers[:32]
    assert not row["qmeta.malformed"]


def test_the_host_that_opens_is_named(tmp_path: Path) -> None:
    data = Envelope(1, Topic.OPENER, b"alice").encode()
    lines = tshark(tmp_path, [segment(data)], "-Y", 'qmeta.opener == "alice"')
    assert "Envelope OPENER alice" in lines[0]


def test_a_list_of_packets_names_the_messages(tmp_path: Path) -> None:
    content = whole(MESSAGES[1]) + whole(MESSAGES[2])
    messages: list[Message] = [
        Envelope(1, Topic.KEYS, content),
        Values(1, Topic.ARRIVED, 1, 14, 1, b"\x80"),
        Values(1, 200, 32, 14, 1, struct.pack("!I", 5)),
    ]
    frames = [segment(message.encode(), number) for number, message in enumerate(messages)]
    lines = tshark(tmp_path, frames)
    assert "Envelope KEYS Detections block 1, Sifted block 1" in lines[0]
    assert "Values ARRIVED block 14" in lines[1]
    assert "Values 200 block 14" in lines[2]


def test_values_that_are_answered_are_linked_with_their_answers(tmp_path: Path) -> None:
    coming = Values(1, Topic.COMING, 32, 1, 1, struct.pack("!I", 5)).encode()
    arrived = Values(1, Topic.ARRIVED, 1, 1, 1, b"\x80").encode()
    frames = [
        segment(coming),
        segment(arrived, seq=1 + len(coming)),
        segment(Answer(1, 0).encode(), answer=True),
    ]
    rows = shown(tmp_path, frames, ["qmeta.response_in", "qmeta.request_in"])
    assert [row["qmeta.response_in"] for row in rows] == [["3"], [], []]
    assert rows[2]["qmeta.request_in"] == ["1"]
