"""The sheets that `make curves` draws, as sheets.toml has them."""

import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from evidence.curves.parameters import BadGrid
from evidence.curves.sheet import Curve, Sheet
from evidence.curves.sheet_marks import MARKS, sensing
from wire.parameters.checks import check_names

OWN = ("name", "experiment", "grid", "curves")
OF_CURVES = tuple(each.name for each in fields(Curve))


def read(path: Path) -> tuple[Sheet, ...]:
    """Return the sheets of a TOML file; raise BadGrid for a key that none has."""
    return tuple(map(_sheet, tomllib.loads(path.read_text())["sheet"]))


def _sheet(given: Mapping[str, Any]) -> Sheet:
    name = given["name"]
    check_names(f"sheet {name}", given, (*OWN, *OF_CURVES), BadGrid)
    common = {key: value for key, value in given.items() if key not in OWN}
    curves = [_curve({"file": name, **common, **own}, given["grid"]) for own in given["curves"]]
    return Sheet(name, given.get("experiment", name), given["grid"], curves)


def _curve(given: dict[str, Any], grid: Mapping[str, Any]) -> Curve:
    check_names(f"curve {given['file']}", given, OF_CURVES, BadGrid)
    marks = given.pop("marks", {})
    levels = [(value, label) for value, label in given.pop("levels", ())]
    limits = sensing(grid["hosts"], grid["states"]) if given.pop("limits", "") else ()
    drawn = [mark for name, places in marks.items() for mark in MARKS[name](places)]
    return Curve(**given, marks=drawn, levels=levels, limits=limits)


SHEETS = read(Path(__file__).with_suffix(".toml"))
