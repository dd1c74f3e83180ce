"""The JSON of dataclasses: its schema, as programs read it, and how one is read back."""

import json
import re
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from wire.malformed import MalformedPacket
from wire.parameters.physics import Device
from wire.results.figures import Figures
from wire.results.run_result import BEGUN, RESULT, Head

Schema = dict[str, Any]
T = TypeVar("T")
PARTS = tuple(type(part.default) for part in fields(Device))
NOTHING: Mapping[str, Schema] = {}
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
MOST_DEPTH = 32  # of lists and objects in a file
MOST_BITS = 1_000  # of an integer: floats have no more
SURROGATES = re.compile("[\ud800-\udfff]")


def schema_of(kind: Any, told: Schema, known: Mapping[str, Schema] = NOTHING) -> Schema:
    """Return the JSON Schema of a type; dataclasses are added to those that have been told.

    `known` are schemas of fields of it that do not follow from their types.
    """
    if kind in (Any, object):
        return {}
    if kind in PLAIN:
        return {"type": PLAIN[kind]}
    if isinstance(kind, UnionType):
        return {"anyOf": [schema_of(each, told) for each in get_args(kind)]}
    if get_origin(kind) in (list, tuple):
        return {"type": "array", "items": schema_of(get_args(kind)[0], told)}
    if get_origin(kind) is dict:
        return {"type": "object", "additionalProperties": schema_of(get_args(kind)[1], told)}
    if kind.__name__ not in told:
        told[kind.__name__] = {}  # keeps its place
        told[kind.__name__] = _schema_of_dataclass(kind, told, known)
    return {"$ref": f"#/$defs/{kind.__name__}"}


def _schema_of_dataclass(kind: Any, told: Schema, known: Mapping[str, Schema]) -> Schema:
    hints = get_type_hints(kind)
    names = [each.name for each in fields(kind)]
    return {
        "type": "object",
        "description": " ".join((kind.__doc__ or "").split()),
        "properties": {
            name: known[name] if name in known else schema_of(hints[name], told) for name in names
        },
        "required": sorted(each.name for each in fields(kind) if _is_there(kind, each)),
        "additionalProperties": False,
    }


def decoded(file: Path) -> dict[str, Any] | list[Any]:
    """Return the object or list of a file of JSON; raise OSError, or MalformedPacket for others."""
    try:
        given = json.loads(file.read_text())
    except (ValueError, RecursionError) as error:
        raise MalformedPacket(f"{file} is not JSON: {error}") from error
    if not isinstance(given, dict | list):
        raise MalformedPacket(f"{file} is neither an object nor a list")
    level: list[Any] = [given]
    for _depth in range(MOST_DEPTH):
        inner = (each.values() if isinstance(each, dict) else each for each in level)
        level = [each for values in inner for each in values if isinstance(each, dict | list)]
    if level:
        raise MalformedPacket(f"{file} is deeper than {MOST_DEPTH} lists or objects")
    return given


def read_begun(folder: Path) -> tuple[str, dict[str, Any]]:
    """Return the process that was to write the result, and what was known when it began.

    Raise OSError or MalformedPacket.
    """
    begun: tuple[str, dict[str, Any]] = _read(
        tuple[str, dict[str, Any]], decoded(folder / BEGUN), BEGUN
    )
    return begun


def read_head(folder: Path) -> Head:
    """Return the head of what a network has left; raise OSError or MalformedPacket."""
    return head_of(decoded(folder / RESULT))


def head_of(given: Any) -> Head:
    """Return the head of a result as its file has it; raise MalformedPacket for anything else."""
    names = {item.name for item in fields(Head)}
    content = read(dict[str, Any], given)
    return read(Head, {name: value for name, value in content.items() if name in names})


def read(kind: type[T], given: Any, place: str = "the result") -> T:
    """Return what decoded JSON says; raise MalformedPacket, which names the place, for others."""
    return cast("T", _read(kind, given, place))


def _read(kind: Any, given: Any, place: str) -> Any:
    if is_dataclass(given) or kind in (Any, object):  # read already, or of any kind
        return given
    if isinstance(kind, UnionType):
        return _read(_fitting(get_args(kind), given, place), given, place)
    origin, inner = get_origin(kind), get_args(kind)
    if origin is dict:
        content = _plain(dict, given, place)
        return {name: _read(inner[1], value, f"{place}.{name}") for name, value in content.items()}
    if origin in (list, tuple):
        return origin(_items(origin, inner, _plain(list, given, place), place))
    if kind in PLAIN:
        return Path(_plain(str, given, place)) if kind is Path else _plain(kind, given, place)
    return _read_dataclass(kind, _plain(dict, given, place), place)


def _items(origin: Any, inner: tuple[Any, ...], given: list[Any], place: str) -> Iterator[Any]:
    kinds = [inner[0]] * len(given) if origin is list or inner[-1] is Ellipsis else inner
    if len(kinds) != len(given):
        raise MalformedPacket(f"{place} has {len(given)} items, not {len(kinds)}")
    for number, (kind, value) in enumerate(zip(kinds, given, strict=True)):
        yield _read(kind, value, f"{place}[{number}]")


def _plain(kind: Any, given: Any, place: str) -> Any:
    """Return a value of the kind as JSON has it: True is no number, and an integer may be one."""
    right = isinstance(given, int | float if kind is float else kind)
    if not right or (isinstance(given, bool) and kind is not bool) or not _can_be_used(given):
        raise MalformedPacket(f"{place}: {reprlib.repr(given)} is not {PLAIN[kind]}")
    return given


def _can_be_used(given: Any) -> bool:
    if isinstance(given, str):
        return not SURROGATES.search(given)
    return not isinstance(given, int) or given.bit_length() <= MOST_BITS


def _read_dataclass(kind: Any, given: dict[str, Any], place: str) -> Any:
    hints = get_type_hints(kind)
    given = {**getattr(kind, "EARLIER", {}), **given}
    there = {each.name: each for each in fields(kind)}
    if unknown := given.keys() - there.keys():
        raise MalformedPacket(f"{place} has unknown names: {', '.join(sorted(unknown))}")
    if missing := [name for name in there if name not in given and _is_needed(there[name])]:
        raise MalformedPacket(f"{place} has no {', '.join(missing)}")
    told = {name: _read(hints[name], each, f"{place}.{name}") for name, each in given.items()}
    return kind(**told)


def _fitting(kinds: tuple[Any, ...], given: Any, place: str) -> Any:
    """Return the one of several types that a value is of; of dataclasses, that with its names."""
    if isinstance(given, Mapping):
        for kind in filter(is_dataclass, kinds):
            needed = {item.name for item in fields(kind) if _is_needed(item)}
            if needed <= given.keys() <= {item.name for item in fields(kind)}:
                return kind
    for kind in kinds:
        if kind in PLAIN or get_origin(kind):
            with suppress(MalformedPacket):
                _read(kind, given, place)
                return kind
    names = ", ".join(getattr(kind, "__name__", str(kind)) for kind in kinds)
    raise MalformedPacket(f"{place}: {reprlib.repr(given)} is none of {names}")


def _is_there(kind: Any, field: Any) -> bool:
    """Whether a field is always written: of figures those without a default, of devices none."""
    return not issubclass(kind, (Figures, Device, *PARTS)) or _is_needed(field)


def _is_needed(field: Any) -> bool:
    return field.default is MISSING and field.default_factory is MISSING
