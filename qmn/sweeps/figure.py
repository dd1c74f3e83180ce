"""Figures: measured points with error bars, the line that theory draws, and a legend."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qmn.sweeps.estimates import Estimate
from qmn.sweeps.experiment import Measure
from qmn.sweeps.parameters import Parameter, Value, Values

LINE_POINTS = 200
MAX_SERIES = 12
MARKERS = "osD^vP*X<>hd"
SIZE_INCHES = (7.2, 4.6)
DOTS_PER_INCH = 150

Point = tuple[Values, Estimate]


@dataclass(frozen=True)
class Mark:
    """A number from elsewhere that is drawn into a figure, with its source."""

    x: float
    y: float
    error: float
    label: str


@dataclass(frozen=True)
class Picture:
    """What one figure shows."""

    title: str
    x: Parameter
    x_label: str
    measure: Measure
    series: Sequence[tuple[str, list[Point]]]
    marks: Sequence[Mark] = field(default=())


def draw(picture: Picture, file: Path) -> None:
    """Write the figure as PNG."""
    mpl.rcParams.update({"font.size": 10, "axes.grid": True, "grid.alpha": 0.3})
    figure = Figure(figsize=SIZE_INCHES, layout="constrained")
    axes = figure.add_subplot()
    for number, (label, points) in enumerate(picture.series):
        _draw_series(axes, picture, number, label, points)
    for mark in picture.marks:
        axes.errorbar(
            mark.x, mark.y, mark.error, fmt="k*", markersize=12, capsize=3, label=mark.label
        )
    axes.set_title(picture.title)
    axes.set_xlabel(picture.x_label)
    axes.set_ylabel(picture.measure.label)
    _scale(axes, picture)
    handles, _labels = axes.get_legend_handles_labels()
    if len(handles) > 6:
        figure.legend(loc="outside right upper", fontsize="small")
    else:
        axes.legend(fontsize="small")
    figure.savefig(file, dpi=DOTS_PER_INCH)


def _draw_series(
    axes: Axes, picture: Picture, number: int, label: str, points: list[Point]
) -> None:
    points = sorted(points, key=lambda point: str(point[0][picture.x.name]))
    if not picture.x.choices:
        points.sort(key=lambda point: float(point[0][picture.x.name]))
    xs = [point[0][picture.x.name] for point in points]
    values = [estimate.value for _values, estimate in points]
    errors = [estimate.error for _values, estimate in points]
    colour = f"C{number}"
    axes.errorbar(
        xs,
        values,
        errors,
        fmt=MARKERS[number % len(MARKERS)],
        color=colour,
        markersize=5,
        capsize=3,
        label=label or "measured",
    )
    line = _theory(picture, points, xs)
    if line:
        name = f"theory, {label}" if label and len(picture.series) == 1 else "theory"
        # One entry in the legend for all lines.
        shown = name if number == 0 else "_" + name
        style = "-" if not picture.x.choices else ":"
        axes.plot(*line, style, color=colour, linewidth=1.2, label=shown, zorder=1)


def _theory(
    picture: Picture, points: list[Point], xs: Sequence[Value]
) -> tuple[list[Value], list[float]] | None:
    """Return the line of theory, None if there is none for all of it."""
    theory: Callable[[Values], float | None] = picture.measure.theory
    others = points[0][0]
    places = list(xs) if picture.x.choices else _dense(picture, xs)
    line = [(place, theory({**others, picture.x.name: place})) for place in places]
    known = [(place, value) for place, value in line if value is not None]
    if len(known) < len(line):
        return None
    return [place for place, _value in known], [value for _place, value in known]


def _dense(picture: Picture, xs: Sequence[Value]) -> list[Value]:
    numbers = [float(x) for x in xs]
    least, most = min(numbers), max(numbers)
    if picture.x.whole:
        return list(xs)
    if _spans_decades(numbers):
        steps = [least * (most / least) ** (i / LINE_POINTS) for i in range(LINE_POINTS + 1)]
    else:
        steps = [least + (most - least) * i / LINE_POINTS for i in range(LINE_POINTS + 1)]
    return [*steps]


def _spans_decades(numbers: Sequence[float]) -> bool:
    least, most = min(numbers), max(numbers)
    return least > 0 and most / least >= 100


def _scale(axes: Axes, picture: Picture) -> None:
    """Choose logarithmic scales where they show more."""
    points = [point for _label, series in picture.series for point in series]
    if not picture.x.choices:
        numbers = [float(values[picture.x.name]) for values, _estimate in points]
        if _spans_decades(numbers):
            axes.set_xscale("log")
    if picture.measure.logarithmic and any(estimate.value > 0 for _values, estimate in points):
        axes.set_yscale("log")
