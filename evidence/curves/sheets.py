"""The sheets that `make curves` draws, as sheets.toml has them: a grid, and curves made of it."""

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from evidence.curves import mdi, relay_theory, theory
from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.entangled_keys import question, sealed_error
from evidence.curves.figure import Limit, Mark, Picture
from evidence.curves.grid import Grid, Row, build
from evidence.curves.links import routes
from evidence.curves.many_hosts import limits
from evidence.curves.parameters import BadGrid
from evidence.curves.pictures import series
from evidence.curves.wald import wald_pairs_to_alarm
from evidence.traffic.erlang import reduced_load
from wire.parameters.checks import check_names

LINKS = 3


@dataclass(frozen=True)
class Curve:
    """One figure: a measure over one axis, with a series for each value of the others."""

    file: str
    title: str
    x: str
    x_label: str
    measure: str
    by: Sequence[str] = ()
    marks: Sequence[Mark] = ()
    levels: Sequence[tuple[float, str]] = ()
    logarithmic: bool = False
    limits: Sequence[Limit] = ()


@dataclass(frozen=True)
class Sheet:
    name: str
    experiment: str
    axes: dict[str, object]
    curves: Sequence[Curve]

    @property
    def grid(self) -> Grid:
        return build(EXPERIMENTS[self.experiment], self.axes)

    def unmeasured(self, rows: Sequence[Row]) -> list[str]:
        """Name every point of a curve at which nothing could be measured."""
        experiment = EXPERIMENTS[self.experiment]
        return [
            f"{experiment.place(values)}: no {curve.measure} was measured"
            for curve in self.curves
            for values, outcome in rows
            if math.isnan(outcome[curve.measure].value)
        ]

    def picture(self, curve: Curve, rows: Sequence[Row]) -> Picture:
        experiment = EXPERIMENTS[self.experiment]
        measure = experiment.measure(curve.measure)
        return Picture(
            curve.title,
            experiment.parameter(curve.x),
            curve.x_label,
            replace(measure, logarithmic=measure.logarithmic or curve.logarithmic),
            series(rows, [experiment.parameter(name) for name in curve.by], curve.measure),
            curve.marks,
            curve.levels,
            curve.limits,
        )


def published_capacity(_places: Sequence[float]) -> list[Mark]:
    label = "experiment, arXiv:1609.00713\n(at the p of this capacity)"
    return [Mark(theory.EXPERIMENT_P, *theory.EXPERIMENT_BITS, label)]


def endless_decoys(lengths_km: Sequence[float]) -> list[Mark]:
    keys = [
        relay_theory.endless_key(
            mdi.SIGNAL, mdi.arrives(km), mdi.DARK_COUNT, mdi.ERROR, mdi.CORRECTION
        )
        for km in lengths_km
    ]
    return line(lengths_km, keys, "endless decoys, Phys. Rev. Lett. 108, 130503")


def wald(fractions: Sequence[float]) -> list[Mark]:
    points = [EXPERIMENTS["seal"].complete({"tapped": fraction}) for fraction in fractions]
    pairs = [wald_pairs_to_alarm(question(v), sealed_error(v)) for v in points]
    return line(fractions, pairs, "Wald's approximations (1945)")


def reduced_loads(loads: Sequence[float]) -> list[Mark]:
    complete = EXPERIMENTS["links"].complete
    points = [complete({"load": load, "links": LINKS}) for load in loads]
    shares = [reduced_load(*routes(v))[0] for v in points]
    return line(loads, shares, f"reduced load, {LINKS} links")


def line(places: Sequence[float], values: Iterable[float], label: str) -> list[Mark]:
    labels = [label, *[""] * (len(places) - 1)]
    return [Mark(*each[:2], 0.0, each[2]) for each in zip(places, values, labels, strict=True)]


def sensing(sensors: Sequence[int], probes: int) -> list[Limit]:
    names = "Heisenberg's limit 1/(N sqrt M)", "standard quantum limit 1/sqrt(N M)"
    lines = zip(*(limits(hosts, probes) for hosts in sensors), strict=True)
    return [
        Limit(name, list(zip(sensors, values, strict=True)))
        for name, values in zip(names, lines, strict=True)
    ]


MARKS: Mapping[str, Callable[[Sequence[float]], list[Mark]]] = {
    "experiment": published_capacity,
    "endless decoys": endless_decoys,
    "wald": wald,
    "reduced loads": reduced_loads,
}
OF_CURVES = tuple(field.name for field in fields(Curve))
OF_SHEETS = ("name", "experiment", "grid", "curves")


def read(path: Path) -> tuple[Sheet, ...]:
    """Return the sheets of a TOML file; raise BadGrid for a key that none has."""
    return tuple(map(_sheet, tomllib.loads(path.read_text())["sheet"]))


def _sheet(content: Mapping[str, Any]) -> Sheet:
    name = content["name"]
    check_names(f"sheet {name}", content, (*OF_SHEETS, *OF_CURVES), BadGrid)
    common = {key: value for key, value in content.items() if key not in OF_SHEETS}
    curves = [
        _curve({"file": name, **common, **curve}, content["grid"]) for curve in content["curves"]
    ]
    return Sheet(name, content.get("experiment", name), content["grid"], curves)


def _curve(content: dict[str, Any], grid: Mapping[str, Any]) -> Curve:
    check_names(f"curve {content['file']}", content, OF_CURVES, BadGrid)
    marks = content.pop("marks", {})
    levels = [(value, label) for value, label in content.pop("levels", ())]
    lines = sensing(grid["hosts"], grid["states"]) if content.pop("limits", "") else ()
    drawn = [mark for name, places in marks.items() for mark in MARKS[name](places)]
    return Curve(**content, marks=drawn, levels=levels, limits=lines)


SHEETS = read(Path(__file__).with_suffix(".toml"))
