"""Faults put into messages that are right: in their bytes, in their JSON, in their fields."""

import json
from collections.abc import Callable
from random import Random
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

MOST_BYTES = 4096
EDGES = (0, 1, 2, 0x7F, 0x80, 0xFF)
NUMBERS = (0, 1, -1, 2, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64, 10**30)
FLOATS = (0.0, -0.0, -1.0, 0.5, 1.0, 1e-300, 1e300, float("inf"), float("-inf"), float("nan"))
TEXTS = ("", "a", "alice", "\0", "ä", "\ud800", "x" * 300, "10.0.0.1", "1e9", "null")
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    *NUMBERS,
    *TEXTS,
    [],
    {},
    [[]],
    {"": None},
    0.5,
    1e400,
)


def spoiled(data: bytes, random: Random) -> bytes:
    """Return bytes with one to three faults in them."""
    changed = bytearray(data)
    for _fault in range(random.choice((1, 1, 1, 2, 3))):
        random.choice(FAULTS)(changed, random)
    return bytes(changed[:MOST_BYTES])


def _flip(data: bytearray, random: Random) -> None:
    if data:
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)


def _put(data: bytearray, random: Random) -> None:
    if data:
        data[random.randrange(len(data))] = random.choice(EDGES)


def _number(data: bytearray, random: Random) -> None:
    """Put what may be a length or a count somewhere."""
    width = random.choice((2, 4, 8))
    if len(data) >= width:
        value = random.choice((0, 1, 7, 8, 255, 2 ** (8 * width - 1), 2 ** (8 * width) - 1))
        at = random.randrange(len(data) - width + 1)
        data[at : at + width] = value.to_bytes(width, random.choice(("big", "little")))


def _cut(data: bytearray, random: Random) -> None:
    del data[random.randrange(len(data) + 1) :]


def _extend(data: bytearray, random: Random) -> None:
    data += random.randbytes(random.choice((1, 2, 3, 4, 8, 16, 100)))


def _repeat(data: bytearray, random: Random) -> None:
    start, end = sorted(random.randrange(len(data) + 1) for _ in range(2))
    at = random.randrange(len(data) + 1)
    data[at:at] = data[start:end]


FAULTS: tuple[Callable[[bytearray, Random], None], ...] = (
    *(_flip, _flip, _put, _put),
    *(_number, _cut, _extend, _repeat),
)


def spoiled_json(data: bytes, random: Random) -> bytes:
    """Return a JSON text of which a value is another, or is missing; or its bytes are spoiled."""
    if random.random() < 0.3:
        return spoiled(data, random)
    return json.dumps(_spoiled_value(json.loads(data), random)).encode()


def _spoiled_value(value: Any, random: Random) -> Any:
    if not value or not isinstance(value, dict | list) or random.random() < 0.2:
        return random.choice(VALUES)
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    at = random.choice(keys)
    changed: Any = value.copy()
    fault = random.random()
    if fault < 0.1:
        del changed[at]
    elif fault < 0.2 and isinstance(changed, dict):
        changed[random.choice(TEXTS)] = random.choice(VALUES)
    elif fault < 0.2:
        changed += changed * random.choice((1, 100))
    else:
        changed[at] = _spoiled_value(value[at], random)
    return changed


def spoil_fields(message: Message, random: Random) -> None:
    """Give a field of a protobuf message, or of one inside it, another value that it can have."""
    field: Any = random.choice(list(message.DESCRIPTOR.fields))
    inside = field.message_type is not None
    if field.is_repeated:
        several: Any = getattr(message, field.name)
        if several and random.random() < 0.3:
            del several[random.randrange(len(several))]
        elif inside:
            part = random.choice(several) if several and random.random() < 0.7 else several.add()
            spoil_fields(part, random)
        else:
            several.append(_field_value(field, random))
    elif inside:
        spoil_fields(getattr(message, field.name), random)
    elif random.random() < 0.1:
        message.ClearField(field.name)
    else:
        setattr(message, field.name, _field_value(field, random))


def _field_value(field: Any, random: Random) -> Any:
    kind = field.cpp_type
    if kind == FieldDescriptor.CPPTYPE_ENUM:
        return random.choice((*field.enum_type.values_by_number, 99, -1))
    if kind == FieldDescriptor.CPPTYPE_STRING:
        bytes_kind = field.type == FieldDescriptor.TYPE_BYTES
        if bytes_kind:
            return random.randbytes(random.choice((0, 1, 3, 4, 5, 100)))
        return random.choice([text for text in TEXTS if text.isprintable()])
    if kind in (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT):
        return random.choice(FLOATS)
    if kind == FieldDescriptor.CPPTYPE_BOOL:
        return random.random() < 0.5
    least, most = RANGES[kind]
    return random.choice([number for number in (*NUMBERS, 3, 4, 5, 8) if least <= number <= most])


RANGES = {
    FieldDescriptor.CPPTYPE_INT32: (-(2**31), 2**31 - 1),
    FieldDescriptor.CPPTYPE_INT64: (-(2**63), 2**63 - 1),
    FieldDescriptor.CPPTYPE_UINT32: (0, 2**32 - 1),
    FieldDescriptor.CPPTYPE_UINT64: (0, 2**64 - 1),
}
