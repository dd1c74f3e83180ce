"""Figures: measured points with error bars, the line that theory draws, and a legend.

Below them residuals, where there is theory: how many standard errors each point is above it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, MaxNLocator

from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Measure
from evidence.curves.parameters import Parameter, Value, Values

LINE_POINTS = 200
MAX_SERIES = 12
TITLE_LETTERS = 64  # of a line
MARKERS = "osD^vP*X<>hd"
LEGEND_INSIDE = 6
PREFIXED_UNITS = ("s", "Hz")  # written as ns or MHz
LINE_WIDTH = 1.2
SIZE_INCHES = (7.2, 4.6)
DOTS_PER_INCH = 150
LIMIT_STYLES = ("--", "-.")
RESIDUALS = 1.2  # so much higher is a figure with residuals
BOUND = 5  # standard errors, beyond which a curve fails

Point = tuple[Values, Estimate]


@dataclass(frozen=True)
class Mark:
    """A number from elsewhere that is drawn into a figure, with its source."""

    x: float
    y: float
    error: float
    label: str
    x_error: float = 0.0


class Limit(NamedTuple):
    """A line that theory draws whatever is measured, with its name."""

    label: str
    points: Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Picture:
    title: str
    x: Parameter
    x_label: str
    measure: Measure
    series: Sequence[tuple[str, list[Point]]]
    marks: Sequence[Mark] = field(default=())
    levels: Sequence[tuple[float, str]] = field(default=())  # horizontal lines with their labels
    limits: Sequence[Limit] = field(default=())


def draw(picture: Picture, *files: Path) -> None:
    """Write the figure, as the ends of the files' names say."""
    figure = drawn(picture)
    for file in files:
        figure.savefig(file, dpi=DOTS_PER_INCH)


@mpl.rc_context({"font.size": 10, "axes.grid": True, "grid.alpha": 0.3})
def drawn(picture: Picture) -> Figure:
    apart = residuals(picture)
    width, height = SIZE_INCHES
    figure = Figure(figsize=(width, height * (RESIDUALS if apart else 1)), layout="constrained")
    axes, *below = figure.subplots(
        2 if apart else 1, sharex=True, squeeze=False, height_ratios=[4, 1] if apart else None
    )[:, 0]
    lines = [
        _draw_series(axes, picture, number, label, points)
        for number, (label, points) in enumerate(picture.series)
    ]
    _draw_marks(axes, picture.marks)
    for level, label in picture.levels:
        axes.axhline(level, color="k", linestyle=":", linewidth=LINE_WIDTH, label=label)
    for limit, style in zip(picture.limits, LIMIT_STYLES, strict=False):
        axes.plot(*zip(*limit.points, strict=True), f"k{style}", label=limit.label)
    axes.set_title(fill(picture.title, TITLE_LETTERS))
    (below or [axes])[-1].set_xlabel(picture.x_label)
    for panel in below:
        _draw_residuals(panel, picture, apart)
    axes.set_ylabel(picture.measure.label)
    _scale(axes, picture)
    _draw_legend(figure, axes, lines)
    return figure


def _draw_marks(axes: Axes, marks: Sequence[Mark]) -> None:
    labels = set[str]()
    for mark in marks:
        axes.errorbar(
            mark.x,
            mark.y,
            mark.error,
            mark.x_error or None,
            fmt="k*",
            markersize=13,
            markerfacecolor="none",
            capsize=3,
            label=None if mark.label in labels else mark.label,
        )
        labels.add(mark.label)


def _draw_legend(figure: Figure, axes: Axes, lines: Sequence[bool]) -> None:
    """Draw the legend; `lines` says of each series whether theory has a line for it."""
    handles, _labels = axes.get_legend_handles_labels()
    if any(lines):
        # Each line has its series' colour: one that stood for several would be of none.
        alone = sum(lines) == 1
        colour, label = (f"C{lines.index(True)}", "theory") if alone else ("none", "lines: theory")
        handles.append(Line2D([], [], color=colour, linewidth=LINE_WIDTH, label=label))
    if len(handles) > LEGEND_INSIDE:
        figure.legend(handles=handles, loc="outside right upper", fontsize="small")
    else:
        axes.legend(handles=handles, fontsize="small")


def residuals(picture: Picture) -> dict[int, list[tuple[Value, float]]]:
    """Return, by series, how many standard errors above theory each point is, if there is any.

    A point without an error has none.
    """
    by_series: dict[int, list[tuple[Value, float]]] = {}
    for number, (_label, points) in enumerate(picture.series):
        for values, estimate in points:
            expected = picture.measure.theory(values)
            if expected is not None and estimate.error > 0:
                apart = (estimate.value - expected) / estimate.error
                by_series.setdefault(number, []).append((values[picture.x.name], apart))
    return by_series


def _draw_residuals(
    axes: Axes, picture: Picture, apart: dict[int, list[tuple[Value, float]]]
) -> None:
    for number, points in apart.items():
        places, errors = zip(*points, strict=True)
        axes.plot(
            places, errors, MARKERS[number % len(MARKERS)], color=f"C{number}", markersize=3.5
        )
    for bound in (-BOUND, BOUND):
        axes.axhline(bound, color="k", linestyle=":", linewidth=LINE_WIDTH)
    axes.axhline(0, color="k", linewidth=LINE_WIDTH)
    most = max(abs(error) for points in apart.values() for _place, error in points)
    axes.set_ylim(-max(most, BOUND) * 1.2, max(most, BOUND) * 1.2)
    axes.set_ylabel("std. errors", fontsize="small")
    if picture.x.unit in PREFIXED_UNITS:
        axes.xaxis.set_major_formatter(EngFormatter(unit=picture.x.unit))


def _draw_series(
    axes: Axes, picture: Picture, number: int, label: str, points: list[Point]
) -> bool:
    """Draw measured points and the line of theory; return whether there is a line."""
    name = picture.x.name
    if not picture.x.choices:
        points = sorted(points, key=lambda point: float(point[0][name]))
    colour = f"C{number}"
    line = _theory(picture, points)
    if line:
        axes.plot(*line, color=colour, linewidth=LINE_WIDTH, zorder=1)
    # A logarithmic scale has no place for what was never seen.
    seen = [point for point in points if point[1].value > 0 or not picture.measure.logarithmic]
    axes.errorbar(
        [values[name] for values, _estimate in seen],
        [estimate.value for _values, estimate in seen],
        [estimate.error for _values, estimate in seen],
        fmt=MARKERS[number % len(MARKERS)],
        color=colour,
        markersize=5,
        capsize=3,
        label=label or "measured",
    )
    return line is not None


def _theory(picture: Picture, points: list[Point]) -> tuple[list[Value], list[float]] | None:
    """Return the line of theory, None if there is none for all of it."""
    theory: Callable[[Values], float | None] = picture.measure.theory
    name = picture.x.name
    if picture.x.choices or picture.measure.given:  # which is known at points alone
        line = [(values[name], theory(values)) for values, _estimate in points]
    else:
        places = _dense(picture, [values[name] for values, _estimate in points])
        line = [(place, theory({**points[0][0], name: place})) for place in places]
    with_theory = [(place, value) for place, value in line if value is not None]
    if len(with_theory) < len(line):
        return None
    return [place for place, _value in with_theory], [value for _place, value in with_theory]


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
    points = [point for _label, series in picture.series for point in series]
    if picture.x.unit in PREFIXED_UNITS:
        axes.xaxis.set_major_formatter(EngFormatter(unit=picture.x.unit))
    if picture.x.whole:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if not picture.x.choices:
        numbers = [float(values[picture.x.name]) for values, _estimate in points]
        if _spans_decades(numbers):
            axes.set_xscale("log")
    seen = [estimate.value for _values, estimate in points if estimate.value > 0]
    if picture.measure.logarithmic and seen:
        axes.set_yscale("log")
        axes.set_ylim(bottom=min(seen) / 3)
