"""The reader of JSON by types: dataclasses, lists, tuples, dictionaries, unions and plain values.

Configurations of programs, results and requests are read by it, each by its own class:

    read(HostConfig, json.loads(text), "the configuration")     MalformedPacket names the place
"""

import re
import reprlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from wire.malformed import MalformedPacket
from wire.parameters.checks import check_names

T = TypeVar("T")
PLAIN = {
    str: "string",
    Path: "string",
    bool: "boolean",
    int: "integer",
    float: "number",
    NoneType: "null",
    dict: "object",
    list: "array",
}
MOST_BITS = 1_000  # of an integer: floats have no more
SURROGATES = re.compile("[\ud800-\udfff]")


def read(kind: type[T], value: Any, place: str = "the result") -> T:
    """Return what decoded JSON says; raise MalformedPacket, which names the place, for others."""
    return cast("T", _read(kind, value, place))


def read_fields(
    kinds: Mapping[str, Any], needed: Collection[str], content: Mapping[str, Any], place: str
) -> dict[str, Any]:
    """Return values of these kinds, by name; raise MalformedPacket for a name too many or few."""
    check_names(place, content, kinds, MalformedPacket)
    if missing := [name for name in needed if name not in content]:
        raise MalformedPacket(f"{place} has no {', '.join(missing)}")
    return {name: _read(kinds[name], each, f"{place}.{name}") for name, each in content.items()}


def _read(kind: Any, json_value: Any, place: str) -> Any:
    if kind in PLAIN:
        return (
            Path(_plain(str, json_value, place))
            if kind is Path
            else _plain(kind, json_value, place)
        )
    if is_dataclass(json_value) or kind in (Any, object):  # read already, or of any kind
        return json_value
    if isinstance(kind, UnionType):
        return _read(_fitting(get_args(kind), json_value, place), json_value, place)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is dict:
        content = _plain(dict, json_value, place)
        return {name: _read(inner[1], value, f"{place}.{name}") for name, value in content.items()}
    if origin in (list, tuple):
        return origin(_items(origin, inner, _plain(list, json_value, place), place))
    return _read_dataclass(kind, _plain(dict, json_value, place), place)


def _items(origin: Any, inner: tuple[Any, ...], items: list[Any], place: str) -> Iterator[Any]:
    kinds = [inner[0]] * len(items) if origin is list or inner[-1] is Ellipsis else inner
    if len(kinds) != len(items):
        raise MalformedPacket(f"{place} has {len(items)} items, not {len(kinds)}")
    for number, (kind, value) in enumerate(zip(kinds, items, strict=True)):
        yield _read(kind, value, f"{place}[{number}]")


def _plain(kind: Any, value: Any, place: str) -> Any:
    """Return a value of the kind as JSON has it: True is no number, and an integer may be one."""
    right = isinstance(value, int | float if kind is float else kind)
    if not right or (isinstance(value, bool) and kind is not bool) or not _can_be_used(value):
        raise MalformedPacket(f"{place}: {reprlib.repr(value)} is not {PLAIN[kind]}")
    return value


def _can_be_used(value: Any) -> bool:
    if isinstance(value, str):
        return not SURROGATES.search(value)
    return not isinstance(value, int) or value.bit_length() <= MOST_BITS


def _read_dataclass(kind: Any, content: dict[str, Any], place: str) -> Any:
    content = {**getattr(kind, "EARLIER", {}), **content}
    return kind(**read_fields(*_fields_of(kind), content, place))


@cache
def _fields_of(kind: Any) -> tuple[dict[str, Any], list[str]]:
    """Return the types of a dataclass's fields by name, and the names that are always there."""
    hints, there = get_type_hints(kind), fields(kind)
    needed = [each.name for each in there if is_needed(each)]
    return {each.name: hints[each.name] for each in there}, needed


def _fitting(kinds: tuple[Any, ...], value: Any, place: str) -> Any:
    """Return the one of several types that a value is of; of dataclasses, that with its names."""
    if isinstance(value, Mapping):
        for kind in kinds:
            if is_dataclass(kind):
                known, needed = _fields_of(cast("Any", kind))
                if set(needed) <= value.keys() <= known.keys():
                    return kind
    for kind in kinds:
        if kind in PLAIN or get_origin(kind):
            with suppress(MalformedPacket):
                _read(kind, value, place)
                return kind
    names = ", ".join(getattr(kind, "__name__", str(kind)) for kind in kinds)
    raise MalformedPacket(f"{place}: {reprlib.repr(value)} is none of {names}")


def is_needed(field: Any) -> bool:
    return field.default is MISSING and field.default_factory is MISSING
