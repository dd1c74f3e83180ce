"""The JSON of dataclasses: its schema, as programs read it, and how one is read back."""

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from wire.malformed import MalformedPacket
from wire.parameters.physics import Device
from wire.results.figures import Figures
from wire.results.run_result import BEGUN, RESULT, SCHEMA, Head
from wire.typed_json import PLAIN, is_needed, read

Schema = dict[str, Any]
PARTS = tuple(type(part.default) for part in fields(Device))
NOTHING: Mapping[str, Schema] = {}
MOST_DEPTH = 32  # of lists and objects in a file


def schema_of(kind: Any, definitions: Schema, schemas: Mapping[str, Schema] = NOTHING) -> Schema:
    """Return the JSON Schema of a type; dataclasses are added to the definitions.

    `known` are schemas of fields of it that do not follow from their types.
    """
    if kind in (Any, object):
        return {}
    if kind in PLAIN:
        return {"type": PLAIN[kind]}
    if isinstance(kind, UnionType):
        return {"anyOf": [schema_of(option, definitions) for option in get_args(kind)]}
    if get_origin(kind) in (list, tuple):
        return {"type": "array", "items": schema_of(get_args(kind)[0], definitions)}
    if get_origin(kind) is dict:
        return {"type": "object", "additionalProperties": schema_of(get_args(kind)[1], definitions)}
    if kind.__name__ not in definitions:
        definitions[kind.__name__] = {}  # keeps its place
        definitions[kind.__name__] = _schema_of_dataclass(kind, definitions, schemas)
    return {"$ref": f"#/$defs/{kind.__name__}"}


def _schema_of_dataclass(kind: Any, definitions: Schema, schemas: Mapping[str, Schema]) -> Schema:
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]
    return {
        "type": "object",
        "description": " ".join((kind.__doc__ or "").split()),
        "properties": {
            name: schemas[name] if name in schemas else schema_of(hints[name], definitions)
            for name in names
        },
        "required": sorted(field.name for field in fields(kind) if _is_there(kind, field)),
        "additionalProperties": False,
    }


def decoded(file: Path) -> dict[str, Any] | list[Any]:
    """Return the object or list of a file of JSON; raise OSError, or MalformedPacket for others."""
    try:
        value = json.loads(file.read_text())
    except (ValueError, RecursionError) as error:
        raise MalformedPacket(f"{file} is not JSON: {error}") from error
    if not isinstance(value, dict | list):
        raise MalformedPacket(f"{file} is neither an object nor a list")
    level: list[Any] = [value]
    for _depth in range(MOST_DEPTH):
        inner = (each.values() if isinstance(each, dict) else each for each in level)
        level = [each for values in inner for each in values if isinstance(each, dict | list)]
    if level:
        raise MalformedPacket(f"{file} is deeper than {MOST_DEPTH} lists or objects")
    return value


def read_begun(folder: Path) -> tuple[str, dict[str, Any]]:
    """Return the process that was to write the result, and what was known when it began.

    Raise OSError or MalformedPacket.
    """
    return read(tuple[str, dict[str, Any]], decoded(folder / BEGUN), BEGUN)


def read_head(folder: Path) -> Head:
    """Return the head of what a network has left; raise OSError or MalformedPacket."""
    return head_of(decoded(folder / RESULT))


def head_of(value: Any) -> Head:
    """Return the head of a result as its file has it; raise MalformedPacket for anything else."""
    names = {item.name for item in fields(Head)}
    content = read(dict[str, Any], value)
    written = content.get("schema", 0)  # older results do not say it
    if not isinstance(written, int) or written > SCHEMA:
        text = f"the result has schema {written!r}, and this qmn reads up to {SCHEMA}"
        raise MalformedPacket(f"{text}: read it by the qmn that wrote it, or a newer one")
    return read(Head, {name: value for name, value in content.items() if name in names})


def _is_there(kind: Any, field: Any) -> bool:
    """Whether a field is always written: of figures those without a default, of devices none."""
    return not issubclass(kind, (Figures, Device, *PARTS)) or is_needed(field)
