"""The page of all options, settings and result fields, made from their declarations.

python -m views.reference > options.md; `make site` has it as a page.
"""

import argparse
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, Field, fields
from math import inf
from typing import Any

from qmn.__main__ import described
from qmn.results.run_result import NetworkResult, RunResult
from qmn.results.schema import json_schema
from views.comments import dataclasses_in, meaning
from views.completion import help_parsers
from wire.parameters.fiber import FiberOptics
from wire.parameters.option import unit_of
from wire.parameters.physics import IDEAL, Device
from wire.parameters.switch import QuantumSwitch

INTRODUCTION = """# All options

    qmn run sdc --length-km 25 --device bob.detectors.efficiency=0.8

This page is made from the declarations in the program: each verb with its options, each setting of
a device, and each field of `result.json`, with unit, default, range and meaning. The source of a
setting is where its default comes from: *ideal* loses nothing and makes no error, and no
publication states *our choice*. Values of [kinds of hosts](nodes.md) have theirs there."""
SHARED_BY = 3  # verbs at least, of an option that stands above them
OPTIONS = ("option", "unit", "default", "range", "meaning")
SETTINGS = ("setting", "unit", "default", "range", "source", "meaning")
FIELDS = ("field", "unit", "type", "always there", "meaning")
OF_NO_RANGE = ("bell_diagonal", "decoys", "noise", "noise_parameters")
OF_FIBERS = {field.name: field for field in fields(FiberOptics)}  # which are options, too
UNSET: tuple[object, ...] = (None, argparse.SUPPRESS, "", [], ())
IN_HELP = re.compile(r"default: ([^)]*)|(?<=\()(?!default)([^()]*)\)$")
NO_DEFAULT = ("repeatable", "docs/", "more than once", "or more")  # ends of help, too
Row = tuple[str, ...]


def page() -> str:
    parts = [INTRODUCTION, *verbs(), "## Settings of devices, fibres and switches"]
    parts += [settings(f"`HOST.{field.name}.…`", field.type) for field in fields(Device)]
    parts += [settings("Fibres", FiberOptics), settings("Quantum switches", QuantumSwitch)]
    return "\n\n".join([*parts, "## Fields of result.json", *results()]) + "\n"


def verbs() -> Iterator[str]:
    """Yield the tables of options: those that verbs share by their group, then each verb's own."""
    tables = {parser: options(parser) for parser in help_parsers(described(whole=True))}
    uses = Counter(row for rows in tables.values() for row in rows)
    shared = {row: title for rows in tables.values() for row, title in rows.items()}
    shared = {row: title for row, title in shared.items() if uses[row] >= SHARED_BY}
    yield "## Options of several verbs"
    for title in dict.fromkeys(shared.values()):
        yield f"### {title}"
        yield table(OPTIONS, [row for row, group in shared.items() if group == title])
    for parser, rows in tables.items():
        rows_here = [row for row in rows if row not in shared]
        groups = dict.fromkeys(shared[row] for row in rows if row in shared)
        yield f"## {parser.prog}"
        yield " ".join((parser.description or "").split())
        if groups:
            yield f"Of those above: {', '.join(groups)}."
        if rows_here:
            yield table(OPTIONS, rows_here)


def options(parser: argparse.ArgumentParser) -> dict[Row, str]:
    """Return the rows of a parser's options, each with the title of its group."""
    rows = {}
    for group in parser._action_groups:
        for action in group._group_actions:
            if action.dest != "help" and not isinstance(action, argparse._SubParsersAction):
                rows[row_of(action)] = str(group.title)
    return rows


def row_of(action: argparse.Action) -> Row:
    name = action.option_strings[-1] if action.option_strings else ""
    value = str(action.metavar or "") if action.nargs != 0 else ""
    choices = ", ".join(map(str, action.choices or ()))
    limits = choices if choices != value else ""
    limits = limits or range_of(getattr(action, "range", None))
    if not limits and name and action.dest in OF_FIBERS:
        limits = declared_range(OF_FIBERS[action.dest])
    default = default_text(action)
    cell = f"`{' '.join(filter(None, (name, value)))}`"
    return cell, unit_of(action.dest, str(action.metavar)), default, limits, str(action.help or "")


def default_text(action: argparse.Action) -> str:
    """Return the default; of an option without a value of its own, that in its help."""
    if action.nargs == 0:
        return "off"
    if action.required:
        return "required"
    if action.default not in UNSET:
        return f"{action.default}"
    named = IN_HELP.search(action.help or "")
    parts = (named[1] or named[2]).split("; ") if named else []
    return "; ".join(part for part in parts if not part.startswith(NO_DEFAULT)) or "none"


def settings(title: str, kind: Any) -> str:
    rows = [
        (
            f"`{field.name}`",
            unit_of(field.name),
            default_of(field),
            declared_range(field),
            source_of(field),
            meaning(kind, field.name),
        )
        for field in fields(kind)
        if {"range", "choices"} & field.metadata.keys() or field.name in OF_NO_RANGE
    ]
    return f"### {title}\n\n{table(SETTINGS, rows)}"


def default_of(field: "Field[Any]") -> str:
    return "none" if field.default in (MISSING, *UNSET) else f"{field.default}"


def source_of(field: "Field[Any]") -> str:
    """Return where the default of a setting comes from; "" if it is not ideal and names none."""
    without_effect = (MISSING, None, "", "none", "ideal", 0, inf)
    one = field.default == 1 and not unit_of(field.name)
    ideal = field.default in without_effect or one
    return field.metadata.get("source") or (IDEAL if ideal else "")


def declared_range(field: "Field[Any]") -> str:
    return ", ".join(field.metadata.get("choices", ())) or range_of(field.metadata.get("range"))


def range_of(limits: tuple[float, float] | None) -> str:
    return f"{limits[0]:g} to {limits[1]:g}" if limits else ""


def results() -> Iterator[str]:
    """Yield a table for each class of results; parameters of jobs are options above."""
    kinds = dataclasses_in(RunResult | NetworkResult)
    for name, kind in json_schema()["$defs"].items():
        properties = kind.get("properties", {})
        if properties and not name.startswith("parameters of "):
            always = kind.get("required", ())
            rows = [
                (
                    f"`{each}`",
                    unit_of(each),
                    type_of(schema),
                    "yes" if each in always else "",
                    meaning(kinds[name], each),
                )
                for each, schema in properties.items()
            ]
            yield f"### {name}\n\n{kind.get('description', '')}\n\n{table(FIELDS, rows)}"


def type_of(schema: dict[str, Any]) -> str:
    if "anyOf" in schema:
        return " or ".join(map(type_of, schema["anyOf"]))
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    inner = schema.get("items") or schema.get("additionalProperties")
    outer = str(schema.get("type", "any"))
    return f"{outer} of {type_of(inner)}" if isinstance(inner, dict) else outer


def table(columns: Iterable[str], rows: Iterable[Row]) -> str:
    lines = [tuple(columns)]
    lines += [("---",) * len(lines[0]), *rows]
    return "\n".join(f"| {' | '.join(map(cell, line))} |" for line in lines)


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    print(page(), end="")
