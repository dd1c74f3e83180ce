"""Messages between an application and its host's stack."""

import pytest

from wire.malformed import MalformedPacket
from wire.socket_calls import (
    HEADER,
    MAX_PAYLOAD,
    Call,
    decode_fields,
    decode_header,
    encode,
    encode_fields,
)


def test_golden_bytes() -> None:
    assert encode(Call.DATA, b"hi") == b"\x04\x00\x00\x00\x02hi"
    message = encode_fields(Call.LISTEN, port=7)
    assert message == b'\x02\x00\x00\x00\x0b{"port": 7}'
    assert decode_header(message[: HEADER.size]) == (Call.LISTEN, 11)
    assert decode_fields(message[HEADER.size :]) == {"port": 7}


@pytest.mark.parametrize(
    "header", [b"\x00\0\0\0\0", b"\x63\0\0\0\0", HEADER.pack(4, MAX_PAYLOAD + 1)]
)
def test_an_unknown_call_or_an_absurd_length_is_malformed(header: bytes) -> None:
    with pytest.raises(MalformedPacket):
        decode_header(header)


@pytest.mark.parametrize("payload", [b"[1]", b"{", b"\xff", b"3", b"[" * 100_000])
def test_fields_that_are_no_object_are_malformed(payload: bytes) -> None:
    with pytest.raises(MalformedPacket):
        decode_fields(payload)
