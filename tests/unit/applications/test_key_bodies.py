"""Bodies of ETSI GS QKD 014: the standard's examples are read, everything else is refused."""

import json
from uuid import UUID

import pytest

from applications.keys.key_assignment import AssignedKey, Assignment
from applications.keys.key_delivery import (
    DeliveredKey,
    KeyRequest,
    decode_id_query,
    decode_key_ids,
    decode_keys,
    decode_query,
    decode_refusal,
    decode_request,
    encode_key_ids,
    encode_keys,
    encode_refusal,
    encode_request,
)
from wire.malformed import MalformedPacket

# Ids and request of the standard's examples (clause 6 and annex B).
ONE, OTHER = "bc490419-7d60-487f-adc1-4ddcc177c139", "0a782fb5-3434-48fe-aa4d-14f41d46cf92"
ASKED = {
    "number": 3,
    "size": 1024,
    "additional_slave_SAE_IDs": ["ABCDEFG", "HIJKLMN"],
    "extension_mandatory": [{"abc_route_type": "direct"}, {"abc_transfer_method": "qkd"}],
    "extension_optional": [{"abc_max_age": 30000}],
}
ASSIGNMENT = Assignment(
    "sae-alice",
    ("sae-bob", "sae-web"),
    (AssignedKey(UUID(ONE), 256, (UUID(OTHER),), b"\x01" * 32),),
    (UUID(int=7),),
)


def test_a_request_is_read() -> None:
    assert decode_request(json.dumps(ASKED).encode()) == KeyRequest(
        3, 1024, ("ABCDEFG", "HIJKLMN"), ("abc_route_type", "abc_transfer_method")
    )
    assert decode_request(b"") == decode_request(b"{}") == KeyRequest(1, None)


@pytest.mark.parametrize(
    "fields",
    [
        {"number": 0},
        {"number": True},
        {"number": 1.0},
        {"number": "3"},
        {"number": 1 << 31},
        {"size": -8},
        {"size": None},
        {"additional_slave_SAE_IDs": "ABC"},
        {"additional_slave_SAE_IDs": ["ABC", "ABC"]},
        {"additional_slave_SAE_IDs": ["A" * 65]},
        {"additional_slave_SAE_IDs": ["\ud800"]},  # half a character
        {"additional_slave_SAE_IDs": [str(each) for each in range(17)]},
        {"extension_mandatory": {"abc": 1}},
        {"extension_optional": ["abc"]},
        {"amount": 1},
    ],
)
def test_a_request_that_is_none_is_refused(fields: dict[str, object]) -> None:
    with pytest.raises(MalformedPacket):
        decode_request(json.dumps(fields).encode())


def test_what_a_client_asks_is_read_as_it_was() -> None:
    for request in (KeyRequest(), KeyRequest(3, 1024, ("ABC", "DEF"))):
        assert decode_request(encode_request(request)) == request
    assert decode_key_ids(encode_key_ids([UUID(ONE), UUID(OTHER)])) == (UUID(ONE), UUID(OTHER))


def test_a_query_has_number_and_size() -> None:
    assert decode_query({"number": [b"3"], "size": [b"1024"]}) == KeyRequest(3, 1024)
    assert decode_query({}) == KeyRequest()
    for query in (
        {"number": [b"1", b"2"]},
        {"number": [b"-1"]},
        {"size": [b"1e3"]},
        {"size": [b"9" * 11]},
        {"size": [b"\xc2\xb2"]},
        {"extension_mandatory": [b"1"]},
    ):
        with pytest.raises(MalformedPacket):
            decode_query(query)


def test_ids_are_read_each_once() -> None:
    body = {"key_IDs": [{"key_ID": ONE}, {"key_ID": OTHER.upper(), "key_ID_extension": {}}]}
    assert decode_key_ids(json.dumps(body).encode()) == (UUID(ONE), UUID(OTHER))
    assert decode_id_query({"key_ID": [ONE.encode()]}) == (UUID(ONE),)
    refused: list[dict[str, object]] = [
        {},
        {"key_IDs": []},
        {"key_IDs": [ONE]},
        {"key_IDs": [{"key_ID": ONE}, {"key_ID": ONE.upper()}]},
        {"key_IDs": [{"key_ID": f"{{{ONE}}}"}]},
        {"key_IDs": [{"key_ID": 7}]},
        {"key_IDs": [{"key_ID": str(UUID(int=each))} for each in range(129)]},
    ]
    for bad in refused:
        with pytest.raises(MalformedPacket):
            decode_key_ids(json.dumps(bad).encode())


def test_a_container_has_keys_in_base64() -> None:
    # RFC 4648, section 10: "foobar" is Zm9vYmFy.
    body = json.dumps({"keys": [{"key_ID": ONE, "key": "Zm9vYmFy"}]}).encode()
    assert encode_keys([DeliveredKey(UUID(ONE), b"foobar")]) == body
    assert decode_keys(body) == [DeliveredKey(UUID(ONE), b"foobar")]
    for bad in (b'{"keys": [{"key_ID": 1}]}', body.replace(b"Zm9v", b"Zm9"), b"[]"):
        with pytest.raises(MalformedPacket):
            decode_keys(bad)


@pytest.mark.parametrize(
    "text", ["Zm9v*YmFy", "Zm9v\nYmFy", "Zm9v YmFy", "Zm9vYm_-", "Zm9vYmF\u00e9"]
)
def test_a_key_with_characters_that_are_not_base64_is_refused(text: str) -> None:
    """RFC 4648, section 3.3: reject them, do not skip them; - and _ are of another alphabet."""
    body = json.dumps({"keys": [{"key_ID": ONE, "key": text}]}).encode()
    with pytest.raises(MalformedPacket, match="key is not base64"):
        decode_keys(body)


def test_a_refusal_has_a_message() -> None:
    body = encode_refusal("size shall be a multiple of 8", [{"size": "257"}])
    assert json.loads(body) == {
        "message": "size shall be a multiple of 8",
        "details": [{"size": "257"}],
    }
    assert decode_refusal(body) == "size shall be a multiple of 8"


def test_an_assignment_is_what_it_was() -> None:
    assert Assignment.decode(ASSIGNMENT.encode()) == ASSIGNMENT


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("master_SAE_ID", ""),
        ("slave_SAE_IDs", []),
        ("void", ["7"]),
        ("void", [OTHER]),  # which is assigned
        ("keys", [{"key_ID": ONE}]),
        ("keys", [{"key_ID": ONE, "size": 257, "stored": []}]),
        ("keys", [{"key_ID": ONE, "size": 1 << 15, "stored": []}]),
        ("keys", [{"key_ID": ONE, "size": 16, "stored": [], "masked": "Zm9v"}]),
        ("keys", [{"key_ID": ONE, "size": 256, "stored": [OTHER]}] * 2),
        ("more", 1),
    ],
)
def test_an_assignment_that_is_none_is_refused(change: str, value: object) -> None:
    with pytest.raises(MalformedPacket):
        Assignment.decode(json.dumps(json.loads(ASSIGNMENT.encode()) | {change: value}).encode())


def test_every_truncation_of_a_body_is_refused() -> None:
    for whole, decode in (
        (ASSIGNMENT.encode(), Assignment.decode),
        (json.dumps(ASKED).encode(), decode_request),
        (encode_keys([DeliveredKey(UUID(ONE), b"foobar")]), decode_keys),
    ):
        for length in range(1, len(whole)):
            with pytest.raises(MalformedPacket):
                decode(whole[:length])
