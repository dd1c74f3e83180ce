"""The bodies of ETSI GS QKD 014 V1.1.1: what applications (SAEs) and key managers (KMEs) exchange.

    SAE                                   KME
    GET  …/{slave_SAE_ID}/status     ->       <-  Status
    POST …/{slave_SAE_ID}/enc_keys   ->       <-  container of keys, each with its id
    POST …/{master_SAE_ID}/dec_keys  ->       <-  the same keys, by their ids

Member names are those of the standard's tables in clause 6.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any
from uuid import UUID

from wire.bounded_json import decode_json
from wire.malformed import MalformedPacket

MAX_REQUEST = 1 << 16  # bytes of a body
MAX_ANSWER = 1 << 19
MAX_DEPTH = 8
MAX_IDS = 128  # keys in one request
MAX_NAMES = 16  # of further slaves, and extensions
MAX_NAME = 64  # bytes of a SAE ID
_REQUEST = {
    "number",
    "size",
    "additional_slave_SAE_IDs",
    "extension_mandatory",
    "extension_optional",
}


@dataclass(frozen=True)
class KeyRequest:
    """An application's request of enc_keys."""

    number: int = 1
    size: int | None = None  # bits; None: the KME's own
    additional: tuple[str, ...] = ()  # further slave SAEs that get the same keys
    mandatory: tuple[str, ...] = ()  # names of extensions that must be heeded


@dataclass(frozen=True)
class DeliveredKey:
    key_id: UUID
    key: bytes


@dataclass(frozen=True)
class Status:
    """A KME's status of the keys for a slave SAE; the names are the standard's."""

    source_KME_ID: str  # noqa: N815
    target_KME_ID: str  # noqa: N815
    master_SAE_ID: str  # noqa: N815
    slave_SAE_ID: str  # noqa: N815
    key_size: int
    stored_key_count: int
    max_key_count: int
    max_key_per_request: int
    max_key_size: int
    min_key_size: int
    max_SAE_ID_count: int  # noqa: N815


def decode_request(body: bytes) -> KeyRequest:
    """Return the request of a body, which may be empty; raise MalformedPacket for any other."""
    fields = _object(decode_json(body or b"{}", MAX_REQUEST, MAX_DEPTH), _REQUEST)
    _extensions(fields, "extension_optional")  # nothing of them is heeded
    return KeyRequest(
        _whole(fields.get("number", 1), "number"),
        _whole(fields["size"], "size") if "size" in fields else None,
        _names(fields.get("additional_slave_SAE_IDs", []), "additional_slave_SAE_IDs"),
        _extensions(fields, "extension_mandatory"),
    )


def decode_query(query: Mapping[str, Sequence[bytes]]) -> KeyRequest:
    """Return the request of a GET, which has number and size at most; or raise MalformedPacket."""
    numbers = {name: _number(_single(query, name), name) for name in query}
    if unknown := query.keys() - {"number", "size"}:
        raise MalformedPacket(f"a GET has number and size, not {min(unknown)!r}: use POST")
    return KeyRequest(numbers.get("number", 1), numbers.get("size"))


def decode_key_ids(body: bytes) -> tuple[UUID, ...]:
    """Return the ids that dec_keys is asked for, each once; raise MalformedPacket for none."""
    names = {"key_IDs", "key_IDs_extension"}
    fields = _object(decode_json(body, MAX_REQUEST, MAX_DEPTH), names)
    return _ids(
        [
            _object(each, {"key_ID", "key_ID_extension"}).get("key_ID")
            for each in _list(fields.get("key_IDs"), "key_IDs", MAX_IDS)
        ]
    )


def encode_request(request: KeyRequest) -> bytes:
    fields: dict[str, Any] = {"number": request.number}
    if request.size is not None:
        fields["size"] = request.size
    if request.additional:
        fields["additional_slave_SAE_IDs"] = request.additional
    return json.dumps(fields).encode()


def encode_key_ids(ids: Sequence[UUID]) -> bytes:
    return json.dumps({"key_IDs": [{"key_ID": str(key_id)} for key_id in ids]}).encode()


def decode_id_query(query: Mapping[str, Sequence[bytes]]) -> tuple[UUID, ...]:
    """Return the id of a GET of dec_keys, which has one; or raise MalformedPacket."""
    if query.keys() != {"key_ID"}:
        raise MalformedPacket("a GET has one key_ID and nothing else: use POST")
    return _ids([_single(query, "key_ID")])


def encode_status(status: Status) -> bytes:
    return json.dumps(asdict(status)).encode()


def encode_keys(keys: Sequence[DeliveredKey]) -> bytes:
    entries = [
        {"key_ID": str(key.key_id), "key": base64.b64encode(key.key).decode()} for key in keys
    ]
    return json.dumps({"keys": entries}).encode()


def decode_keys(body: bytes) -> list[DeliveredKey]:
    """Return the keys of a container; raise MalformedPacket if it is not one."""
    fields = _object(decode_json(body, MAX_ANSWER, MAX_DEPTH), {"keys", "key_container_extension"})
    names = {"key_ID", "key", "key_ID_extension", "key_extension"}
    keys = [_object(item, names) for item in _list(fields.get("keys"), "keys", MAX_IDS)]
    ids = _ids([key.get("key_ID") for key in keys])
    return [
        DeliveredKey(key_id, decode_base64(key.get("key")))
        for key_id, key in zip(ids, keys, strict=True)
    ]


def encode_refusal(message: str, details: Sequence[Mapping[str, Any]] = ()) -> bytes:
    return json.dumps(
        {"message": message} | ({"details": list(details)} if details else {})
    ).encode()


def decode_refusal(body: bytes) -> str:
    """Return the message of an error; raise MalformedPacket if it has none."""
    fields = _object(decode_json(body, MAX_REQUEST, MAX_DEPTH), {"message", "details"})
    message = fields.get("message")
    if not isinstance(message, str):
        raise MalformedPacket("an error without a message")
    return message


def decode_base64(text: object) -> bytes:
    """Return the bytes of a base64 string; raise MalformedPacket if it is not one."""
    try:
        if not isinstance(text, str):
            raise MalformedPacket("key is not a string")
        return base64.b64decode(text, validate=True)
    except ValueError as error:
        raise MalformedPacket(f"key is not base64: {error}") from error


def decode_id(text: object) -> UUID:
    """Return the UUID of its text, written as RFC 4122 has it; or raise MalformedPacket."""
    try:
        if isinstance(text, str) and text.lower() == str(parsed := UUID(text)):
            return parsed
    except ValueError:
        pass
    raise MalformedPacket(f"{str(text)[:MAX_NAME]!r} is not a UUID")


def decode_name(text: object) -> str:
    """Return a SAE ID; raise MalformedPacket for anything else."""
    try:
        if isinstance(text, str) and 0 < len(text.encode()) <= MAX_NAME:
            return text
    except UnicodeEncodeError:  # half a character, which JSON can write
        pass
    raise MalformedPacket(f"a SAE ID is a string of 1 to {MAX_NAME} bytes")


def _ids(texts: Sequence[object]) -> tuple[UUID, ...]:
    ids = tuple(decode_id(text) for text in texts)
    if not ids or len(set(ids)) < len(ids):
        raise MalformedPacket("key IDs: name at least one, and each once")
    return ids


def _names(value: object, name: str) -> tuple[str, ...]:
    names = tuple(decode_name(item) for item in _list(value, name, MAX_NAMES))
    if len(set(names)) < len(names):
        raise MalformedPacket(f"{name} has a SAE ID twice")
    return names


def _extensions(fields: dict[str, Any], name: str) -> tuple[str, ...]:
    extensions = _list(fields.get(name, []), name, MAX_NAMES)
    return tuple(key for extension in extensions for key in _object(extension))


def _object(value: object, names: set[str] | None = None) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MalformedPacket("an object of JSON is wanted")
    if names is not None and (unknown := value.keys() - names):
        raise MalformedPacket(f"unknown member {min(unknown)[:MAX_NAME]!r}")
    return value


def _list(value: object, name: str, most: int) -> list[Any]:
    if not isinstance(value, list) or len(value) > most:
        raise MalformedPacket(f"{name} is an array of at most {most}")
    return value


def _whole(value: object, name: str) -> int:
    if type(value) is not int or not 0 < value < 1 << 31:
        raise MalformedPacket(f"{name} is a whole number from 1")
    return value


def _single(query: Mapping[str, Sequence[bytes]], name: str) -> str:
    if len(query[name]) != 1 or not query[name][0].isascii():
        raise MalformedPacket(f"{name[:MAX_NAME]!r} is to be there once, in ASCII")
    return query[name][0].decode()


def _number(text: str, name: str) -> int:
    if not text.isdigit() or len(text) > 10:
        raise MalformedPacket(f"{name[:MAX_NAME]!r} is a whole number from 1")
    return _whole(int(text), name)
