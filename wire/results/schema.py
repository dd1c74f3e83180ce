"""The JSON of dataclasses: its schema, as programs read it, and how one is read back."""

import json
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from wire.parameters.physics import Device
from wire.results.figures import Figures
from wire.results.network_facts import NetworkFacts
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
}


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


def read_begun(folder: Path) -> tuple[str, dict[str, Any]]:
    """Return the process that was to write the result, and what was known when it began."""
    runner, given = json.loads((folder / BEGUN).read_text())
    return runner, given


def read_head(folder: Path) -> Head:
    """Return the head of what a network has left; raise OSError or ValueError if it left none."""
    given = json.loads((folder / RESULT).read_text())
    if not isinstance(given, dict):
        raise ValueError(f"{folder / RESULT} is not an object")
    return head_of(given)


def head_of(given: dict[str, Any]) -> Head:
    """Return the head of a result as its file has it."""
    known = {each.name for each in fields(Head)}
    return Head(**{name: value for name, value in given.items() if name in known})


def read(kind: type[T], given: Any) -> T:
    """Return what decoded JSON says; raise TypeError or KeyError for anything else."""
    return cast("T", _read(kind, given))


def _read(kind: Any, given: Any) -> Any:
    if is_dataclass(given):  # read already
        return given
    if isinstance(kind, UnionType):
        return None if given is None else _read(_fitting(get_args(kind), given), given)
    if get_origin(kind) is list:
        return [_read(get_args(kind)[0], each) for each in given]
    if get_origin(kind) is dict:
        return {name: _read(get_args(kind)[1], each) for name, each in given.items()}
    if kind in (NetworkFacts, Device):
        return kind.from_dict(given)
    if not is_dataclass(kind):
        return given
    hints = get_type_hints(kind)
    known = {name: _read(hints[name], value) for name, value in given.items() if name in hints}
    return cast("Any", kind)(**{**given, **known})  # which refuses a name that it does not have


def _fitting(kinds: tuple[Any, ...], given: Any) -> Any:
    """Return the one of several types that a value is of; of dataclasses, that with its names.

    Raise TypeError if it is of none.
    """
    if isinstance(given, Mapping):
        for kind in filter(is_dataclass, kinds):
            needed = {each.name for each in fields(kind) if _is_needed(each)}
            if needed <= given.keys() <= {each.name for each in fields(kind)}:
                return kind
    for kind in kinds:
        if kind is not NoneType and (kind in PLAIN or get_origin(kind)):
            return kind
    raise TypeError(f"{given!r} is none of {', '.join(kind.__name__ for kind in kinds)}")


def _is_there(kind: Any, field: Any) -> bool:
    """Whether a field is always written: of figures those without a default, of devices none."""
    return not issubclass(kind, (Figures, Device, *PARTS)) or _is_needed(field)


def _is_needed(field: Any) -> bool:
    return field.default is MISSING and field.default_factory is MISSING
