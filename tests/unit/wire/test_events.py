"""The quantum event log."""

import json
from contextlib import suppress

import pytest

from wire.dispatcher_pb2 import BlockId, Event
from wire.events import (
    decode_record,
    encode_record,
    fields_text,
    format_line,
    to_fields,
    to_json,
)
from wire.malformed import MalformedPacket


def test_a_line_has_time_node_kind_block_and_counts() -> None:
    event = Event(
        time_ns=1_700_000_000_123_456_789,
        node="alice",
        kind="send",
        block=BlockId(session=0xAB, number=3, half=1),
        port="alice-q0",
        photons=8,
        lost=2,
    )
    assert format_line(event) == (
        "2023-11-14T22:13:20.123456789Z alice    send          "
        "session=00000000000000ab block=3/1 port=alice-q0 photons=8 lost=2"
    )


EVENT = Event(
    time_ns=1_700_000_000_000_000_001,
    node="alice",
    kind="send",
    block=BlockId(session=3, number=1, half=0),
    port="alice-q0",
    photons=8,
)


def test_a_record_is_a_magic_number_a_version_and_the_message() -> None:
    data = encode_record(EVENT)
    assert data[:4].hex() == "51450100"
    assert Event.FromString(data[4:]) == EVENT
    assert decode_record(data) == EVENT


def test_every_spoiled_record_is_an_event_or_refused() -> None:
    data = encode_record(EVENT)
    for size in range(4):
        with pytest.raises(MalformedPacket):
            decode_record(data[:size])
    for place in range(len(data)):
        spoiled = bytearray(data)
        spoiled[place] ^= 0xFF
        with suppress(MalformedPacket):
            assert isinstance(decode_record(bytes(spoiled)), Event)


def test_a_field_of_a_later_version_is_kept() -> None:
    data = encode_record(EVENT) + b"\xa2\x06\x03new"  # field 100: "new"
    assert encode_record(decode_record(data)) == data
    assert format_line(decode_record(data)) == format_line(EVENT)


def test_json_has_the_session_as_the_log_shows_it() -> None:
    assert to_json(EVENT) == {
        "time": "2023-11-14T22:13:20.000000001Z",
        "time_ns": 1_700_000_000_000_000_001,
        "node": "alice",
        "kind": "send",
        "session": "0000000000000003",
        "block": 1,
        "half": 0,
        "port": "alice-q0",
        "photons": 8,
    }


@pytest.mark.parametrize(
    "event",
    [
        EVENT,
        Event(node="q1", kind="open", port="2", detail="2 -> 3"),
        Event(node="bob", kind="measure", block=BlockId(session=2**64 - 1), photon=7, lost=3),
        Event(node='a "quoted" \\ name', kind="tune", detail="tab\t, line\n, \u20ac, \U0001f408"),
        Event(),
    ],
)
def test_fields_as_text_are_the_fields(event: Event) -> None:
    assert json.loads(f"{{{fields_text(event)}}}") == to_fields(event)
