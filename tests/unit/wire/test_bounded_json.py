"""JSON from the network is read in bounds, and strictly."""

import json

import pytest

from wire.bounded_json import decode_json
from wire.malformed import MalformedPacket


def test_what_is_json_is_read() -> None:
    value = {"a": [1, ']]]]{{{{\\"[', None], "ü": {"b": 2.5}}
    assert decode_json(json.dumps(value).encode(), 1000, 2) == value


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b'"' + b"a" * 1000 + b'"', "1002 bytes"),
        (b"[" * 4 + b"]" * 4, "deeper than 3"),
        (b"[" * 900, "deeper than 3"),
        (b'{"a": 1, "a": 2}', "twice"),
        (b"NaN", "NaN is not JSON"),
        (b"[-Infinity]", "not JSON"),
        (b'"\xff"', "not JSON"),
        (b"", "not JSON"),
        (b"1" * 999, None),
        (b"{} {}", "not JSON"),
    ],
)
def test_what_is_not_is_refused(data: bytes, why: str | None) -> None:
    if why is None:  # Python's integers have no end: the limit of bytes is theirs
        assert decode_json(data, 1000, 3) == int(data)
        return
    with pytest.raises(MalformedPacket, match=why):
        decode_json(data, 1000, 3)
