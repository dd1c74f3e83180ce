"""JSON from the network: limited size and depth, every name once, and no extensions of JSON."""

import json
import re
from typing import Any, NoReturn

from wire.malformed import MalformedPacket

_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_OPENING, _CLOSING = frozenset("[{"), frozenset("]}")


def decode_json(data: bytes, most_bytes: int, most_depth: int) -> object:
    """Return what the bytes say; raise MalformedPacket if they are not such JSON."""
    if len(data) > most_bytes:
        raise MalformedPacket(f"JSON of {len(data)} bytes, at most {most_bytes} are read")
    try:
        text = data.decode()
        if _depth(text) > most_depth:
            raise MalformedPacket(f"JSON is deeper than {most_depth} lists or objects")
        return json.loads(text, object_pairs_hook=_once_each, parse_constant=_refuse)
    except ValueError as error:  # of which UnicodeDecodeError is one
        raise MalformedPacket(f"not JSON: {error}") from error


def _depth(text: str) -> int:
    depth = deepest = 0
    for character in _STRING.sub("", text):
        depth += (character in _OPENING) - (character in _CLOSING)
        deepest = max(deepest, depth)
    return deepest


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        raise ValueError("a name comes twice in an object")
    return fields


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not JSON")
