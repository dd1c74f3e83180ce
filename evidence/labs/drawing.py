"""The figures of a lab: our points and line, and the published points as stars beside them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Measure
from evidence.curves.figure import Mark, Picture, Point, draw
from evidence.curves.parameters import Parameter, Values
from evidence.labs.lab import Chart, Finding, Published

X = "x"
Series = Sequence[tuple[float, Estimate]]  # places on an axis, and what was measured there


def draw_charts(charts: Sequence[Chart], findings: Sequence[Finding], folder: Path) -> list[Path]:
    files = []
    for chart in charts:
        files.append(folder / f"{chart.name}.png")
        draw(picture(chart, [each for each in findings if each.chart == chart.name]), files[-1])
    return files


def draw_several(
    file: Path,
    title: str,
    axes: tuple[str, str],
    series: Mapping[str, Series],
    marks: Sequence[Mark] = (),
    logarithmic: bool = False,
) -> Path:
    """Draw several series of ours over one axis, by name; return the file."""
    lines: list[tuple[str, list[Point]]] = [
        (name, [({X: at}, each) for at, each in points]) for name, points in series.items()
    ]
    measure = Measure(title, axes[1], lambda _values: None, logarithmic)
    draw(Picture(title, Parameter(X, 0.0), axes[0], measure, lines, marks), file)
    return file


def picture(chart: Chart, findings: Sequence[Finding]) -> Picture:
    """Return what a chart shows of its findings; a closed form is the line, and no star.

    A published range is as long a bar.
    """
    places = [(each, each.at) for each in findings if each.at is not None]
    theory = chart.theory

    def expected(values: Values) -> float | None:
        return None if theory is None else theory(float(values[X]))

    return Picture(
        chart.title,
        Parameter(X, 0.0),
        chart.x,
        Measure(chart.name, chart.y, expected, chart.logarithmic),
        [(chart.ours, [({X: at}, each.ours) for each, at in places])],
        [
            Mark(at, each.published.value, _bar(each.published), chart.theirs, each.at_error)
            for each, at in places
            if each.published is not None and _bar(each.published)
        ],
    )


def _bar(published: Published) -> float:
    return published.half_range + published.error
