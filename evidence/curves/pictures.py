"""The figures of a sweep: one for each measure, over the axis with the most values."""

import math
from collections.abc import Sequence

from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Measure, Outcome
from evidence.curves.figure import MAX_SERIES, Picture, Point
from evidence.curves.grid import Grid
from evidence.curves.parameters import Parameter, Values

Rows = Sequence[tuple[Values, Outcome]]


def pictures(grid: Grid, rows: Rows) -> list[Picture]:
    """Return a picture for each measure; none if nothing was varied."""
    x = horizontal(grid)
    if x is None:
        return []
    others = [grid.experiment.parameter(name) for name in grid.varied if name != x.name]
    return [
        _picture(grid, rows, measure, measure.over or x, others)
        for measure in grid.experiment.measures
        if not all(math.isnan(outcome[measure.name].value) for _values, outcome in rows)
    ]


def _picture(
    grid: Grid, rows: Rows, measure: Measure, x: Parameter, others: Sequence[Parameter]
) -> Picture:
    x_label = x.label
    if measure.over is not None:
        x_label = grid.experiment.measure(x.name).label
    if measure.over is not None or measure.given:
        # Where it was not measured, the place on the axis is not known either.
        seen = [row for row in rows if not math.isnan(row[1][measure.name].value)]
        rows = [(measure.place(values, outcome), outcome) for values, outcome in seen]
    lines = series(rows, others, measure.name)[:MAX_SERIES]
    return Picture(grid.experiment.what, x, x_label, measure, lines)


def horizontal(grid: Grid) -> Parameter | None:
    varied = [grid.experiment.parameter(name) for name in grid.varied]
    varied.sort(key=lambda each: (bool(each.choices), -len(grid.axes[each.name])))
    return varied[0] if varied else None


def series(rows: Rows, by: Sequence[Parameter], measure: str) -> list[tuple[str, list[Point]]]:
    groups: dict[str, list[tuple[Values, Estimate]]] = {}
    for values, outcome in rows:
        label = ", ".join(each.formatted(values[each.name]) for each in by)
        groups.setdefault(label, []).append((values, outcome[measure]))
    return list(groups.items())
