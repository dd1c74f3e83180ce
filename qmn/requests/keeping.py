"""The parameters that result.json keeps of a request, and how they are read back.

Kept are options of a request and of its parts, by their names, but those of a class's NOT_KEPT,
which a result tells elsewhere, or which do not change what comes out, and those that a part's
metadata has as `not_kept`. Metadata of a field can have `kept`, another name; `of`, a field without
which this one means nothing.
"""

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qmn.options import NO_KINDS, Filling, Kind, Kinds, as_declared
from wire import typed_json
from wire.results.run_result import Parameter

if TYPE_CHECKING:
    from dataclasses import Field

    from _typeshed import DataclassInstance


def kept(request: "DataclassInstance", without: Collection[str] = ()) -> dict[str, Parameter]:
    """Return what a result keeps of a request, by name; of what is None nothing."""
    told: dict[str, Parameter] = {}
    for each in fields(request):
        value = getattr(request, each.name)
        if is_dataclass(value) and not isinstance(value, type):
            told |= kept(value, each.metadata.get("not_kept", ()))
        elif (name := _name(type(request), each, without)) and value is not None:
            of = each.metadata.get("of")
            if of is None or getattr(request, of) is not None:
                told[name] = _plain(value)
    return told


def read_kept(
    kind: type[Kind], given: Mapping[str, Any], kinds: Kinds = NO_KINDS, **known: Any
) -> Kind:
    """Return the request that a result has kept; raise MalformedPacket for anything else."""
    told = read_fields(kept_fields(kind, kinds), given)
    request: Kind = Filling(told, known, kinds, _name, as_declared).fill(kind)
    return request


def read_fields(kept: "Mapping[str, Field[Any]]", given: Mapping[str, Any]) -> dict[str, Any]:
    kinds = {name: each.type for name, each in kept.items()}
    needed = [name for name, each in kept.items() if typed_json.is_needed(each)]
    return typed_json.read_fields(kinds, needed, given, "parameters")


def kept_fields(
    kind: "type[DataclassInstance]", kinds: Kinds = NO_KINDS, without: Collection[str] = ()
) -> "dict[str, Field[Any]]":
    found: dict[str, Field[Any]] = {}
    for each in fields(kind):
        part: Any = kinds.get(each.name, each.type)
        if isinstance(part, type) and is_dataclass(part):
            found |= kept_fields(part, kinds, each.metadata.get("not_kept", ()))
        elif name := _name(kind, each, without):
            found[name] = each
    return found


def _name(kind: Any, each: "Field[Any]", without: Collection[str]) -> str | None:
    if each.name in without or each.name in getattr(kind, "NOT_KEPT", ()):
        return None
    named: str | None = each.metadata.get("kept")
    return named or (each.name if "help" in each.metadata else None)


def _plain(value: Any) -> Parameter:
    if isinstance(value, tuple):
        return list(value)
    plain: Parameter = str(value) if isinstance(value, Path) else value
    return plain
