"""The layout of a message's fields, read off the classes that encode and decode it.

Files generated from here cannot drift apart from them: the tables of the Wireshark
dissectors (views/dissection/dissectors.py) and the scapy layers (views/dissection/scapy_layers.py).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from struct import Struct, calcsize
from types import MappingProxyType
from typing import Any

from wire import device
from wire.device import DeviceSettings
from wire.metadata.blocks import Block, Frame, Report
from wire.metadata.decoding import KINDS
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.monitor_messages import Quantity
from wire.outcomes import Pauli

Enums = Mapping[str, type[IntEnum]]
ENUMS: Enums = MappingProxyType(
    {
        "service": Service,
        "handshake": Handshake,
        "verdict": Verdict,
        "rotation": Pauli,
        "reason": Reason,
        "monitor_end": Reason,
        "topic": Topic,
        "quantity": Quantity,
    }
)
OPEN = {"topic"}  # whose numbers need no name: services define their own
# The fields behind the fixed ones. A counted list has its number of elements as last fixed field;
# numbers that are packed without gaps are as many as a fixed field, or the ones before them, say.
TEXT, BYTES, COUNTED, UNTIL_END, PACKED = "text", "bytes", "counted", "until_end", "packed"


@dataclass(frozen=True)
class Field:
    name: str
    offset: int  # from the end of the header
    size: int
    kind: str  # uint, int, double, ipv4, text or bytes
    values: Mapping[int, str] | None = None  # names of numbers


@dataclass(frozen=True)
class Tail:
    """The part behind the fixed fields: text, bytes, elements with fields, or numbers."""

    name: str
    kind: str
    element: tuple[Field, ...] = ()
    count: str = ""  # of packed numbers: the field that says how many, or the bits that do
    width: int = 0  # bits of each


@dataclass(frozen=True)
class Layout:
    name: str
    number: int
    size: int  # of the fixed fields
    fields: tuple[Field, ...]
    tails: tuple[Tail, ...] = ()


def metadata_layouts() -> list[Layout]:
    return [_layout(kind) for kind in KINDS.values()]


def device_layouts() -> list[Layout]:
    return [_layout(kind) for kind in device.kinds().values()]


def settings_fields() -> tuple[Field, ...]:
    """Return the fields of device settings, each four bytes."""
    names = [item.name for item in fields(DeviceSettings)]
    return tuple(Field(name, 4 * place, 4, "uint") for place, name in enumerate(names))


def placed(form: Struct, names: list[str], enums: Enums = ENUMS) -> tuple[Field, ...]:
    """Return the fields of a struct; raise ValueError if these are not as many names."""
    codes = re.findall(r"(\d*)([a-zA-Z?])", form.format)
    placed_fields: list[Field] = []
    offset, left = 0, list(names)
    for count, code in codes:
        for item in [count + code] if code in "sx" else [code] * int(count or 1):
            size = calcsize(f"!{item}")
            if code != "x":
                if not left:
                    raise ValueError(f"{form.format} has more fields than {', '.join(names)}")
                placed_fields.append(_field(left.pop(0), offset, size, code, enums))
            offset += size
    if left:
        raise ValueError(f"{form.format} has no place for {', '.join(left)}")
    return tuple(placed_fields)


def _field(name: str, offset: int, size: int, code: str, enums: Enums) -> Field:
    if code == "s":
        named = {
            "source": "ipv4",
            "target": "ipv4",
            "peer": "ipv4",
            "opener": "ipv4",
            "acceptor": "ipv4",
            "node": "ipv4",
            "master": "text",
            "slave": "text",
            "name": "text",
            "host": "text",
            "obstacle": "text",
        }
        return Field(name, offset, size, named.get(name, "bytes"))
    if code == "d":
        return Field(name, offset, size, "double")
    values = {int(member): member.name for member in enums[name]} if name in enums else None
    return Field(name, offset, size, "int" if code in "bhiq" else "uint", values)


def _layout(kind: type[Message]) -> Layout:
    tails = _tails(kind)
    counted = [f"{tail.name}_count" for tail in tails if tail.kind == COUNTED]
    variable = {tail.name for tail in tails}
    names = [item.name for item in fields(kind) if item.name not in {"session", *variable}]
    fixed = placed(kind.FIELDS, [*names, *counted])
    return Layout(kind.__name__, kind.KIND, kind.FIELDS.size, fixed, tails)


def _tails(kind: type[Message]) -> tuple[Tail, ...]:
    if kind is Answer:
        return (Tail("text", TEXT),)
    if kind is Block:
        return (Tail("frames", COUNTED, _element(Frame)),)
    if kind is Report:
        number = (Field("frame", 0, 4, "uint"),)
        return (Tail("failed", COUNTED, number), Tail(fields(kind)[-1].name, BYTES))
    if kind in (Values, Envelope):
        return (Tail(fields(kind)[-1].name, BYTES),)
    if each := kind.ELEMENTS:
        return (Tail(each.name, UNTIL_END, placed(each.form, list(each.names))),)
    return ()


def _element(kind: Any) -> tuple[Field, ...]:
    return placed(kind.FIELDS, [item.name for item in fields(kind)])
