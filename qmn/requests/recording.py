"""The parameters of a request in result.json: which there are, written and read back.

Each is declared where its field is (wire.parameters.option), in a request or a part of it:

    loss: float | None = option(None, "of a fibre")              recorded as loss
    json: bool = option(False, "print JSON", recorded=False)     not recorded
    path: Path = field(metadata=recorded_as("application"))      no option, recorded by that name
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qmn.network.options import GONE
from qmn.options import NO_PARTS, Kind, OptionReader, Parts
from wire import typed_json
from wire.parameters.option import declared
from wire.results.run_result import Parameter

if TYPE_CHECKING:
    from dataclasses import Field

    from _typeshed import DataclassInstance


def recorded(request: "DataclassInstance") -> dict[str, Parameter]:
    """Return the parameters of a request that a result records, by name, but for None."""
    parameters: dict[str, Parameter] = {}
    for field in fields(request):
        value = getattr(request, field.name)
        if is_dataclass(value) and not isinstance(value, type):
            parameters |= recorded(value)
        elif (name := recorded_name(field)) and value is not None:
            of = declared(field).get("of")
            if of is None or getattr(request, of) is not None:
                parameters[name] = _plain(value)
    return parameters


def recorded_name(option: "Field[Any]") -> str | None:
    """Return the name of a field's parameter in result.json, None if it has none."""
    declaration = declared(option)
    if "help" in declaration:
        return option.name if declaration.get("recorded", True) else None
    return declaration.get("recorded_as")


class RecordReader(OptionReader):
    def name_of(self, option: "Field[Any]") -> str | None:
        return recorded_name(option)


def read_recorded(
    kind: type[Kind], parameters: Mapping[str, Any], parts: Parts = NO_PARTS, **known: Any
) -> Kind:
    """Return the request that a result has recorded; raise MalformedPacket for anything else."""
    values = read_fields(recorded_fields(kind, parts), parameters)
    return RecordReader(values, known, parts).read(kind)


def read_fields(fields_: "Mapping[str, Field[Any]]", values: Mapping[str, Any]) -> dict[str, Any]:
    values = {name: value for name, value in values.items() if name not in GONE}
    kinds = {name: each.type for name, each in fields_.items()}
    needed = [name for name, each in fields_.items() if typed_json.is_needed(each)]
    return typed_json.read_fields(kinds, needed, values, "parameters")


def recorded_fields(
    kind: "type[DataclassInstance]", parts: Parts = NO_PARTS
) -> "dict[str, Field[Any]]":
    by_name: dict[str, Field[Any]] = {}
    for field in fields(kind):
        part: Any = parts.get(field.name, field.type)
        if isinstance(part, type) and is_dataclass(part):
            by_name |= recorded_fields(part, parts)
        elif name := recorded_name(field):
            by_name[name] = field
    return by_name


def _plain(value: Any) -> Parameter:
    if isinstance(value, tuple):
        return list(value)
    plain: Parameter = str(value) if isinstance(value, Path) else value
    return plain
