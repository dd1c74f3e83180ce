"""A curve that `make curves` draws, and a sheet: the grid that curves are made of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.figure import Limit, Mark, Picture
from evidence.curves.grid import Grid, Row, build
from evidence.curves.pictures import series


@dataclass(frozen=True)
class Curve:
    """One figure: a measure over one axis, with a series for each value of the others."""

    file: str
    title: str
    x: str
    x_label: str
    measure: str
    by: Sequence[str] = ()
    marks: Sequence[Mark] = field(default=())
    levels: Sequence[tuple[float, str]] = field(default=())
    logarithmic: bool = False
    limits: Sequence[Limit] = field(default=())


@dataclass(frozen=True)
class Sheet:
    """A grid and its curves."""

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
        """Return a curve of the sheet with these points."""
        experiment = EXPERIMENTS[self.experiment]
        measure = experiment.measure(curve.measure)
        if curve.logarithmic:
            measure = replace(measure, logarithmic=True)
        return Picture(
            curve.title,
            experiment.parameter(curve.x),
            curve.x_label,
            measure,
            series(rows, [experiment.parameter(name) for name in curve.by], curve.measure),
            curve.marks,
            curve.levels,
            curve.limits,
        )
