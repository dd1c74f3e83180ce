"""The residuals that are drawn below figures: standard errors between a point and theory."""

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import pytest

from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Measure
from evidence.curves.figure import Picture, Point, draw, drawn, residuals
from evidence.curves.parameters import Parameter
from evidence.networks.job_sweep import WHAT

X = Parameter("x", 0.0)


def picture(*points: tuple[float, float, float], theory: bool = True) -> Picture:
    """Return a picture of points (x, value, error), beside a theory of 2 x or none."""
    measure = Measure(
        "y", "y", (lambda values: 2 * float(values["x"])) if theory else (lambda _: None)
    )
    series: list[Point] = [({"x": x}, Estimate(value, error)) for x, value, error in points]
    return Picture("title", X, "x", measure, [("", series)])


def test_a_point_is_so_many_of_its_errors_above_theory() -> None:
    assert residuals(picture((1.0, 2.5, 0.25), (2.0, 3.0, 0.5))) == {0: [(1.0, 2.0), (2.0, -2.0)]}


def test_what_has_no_error_or_no_theory_has_no_residual() -> None:
    assert residuals(picture((1.0, 2.5, 0.0))) == {}
    assert residuals(picture((1.0, 2.5, 0.1), theory=False)) == {}


def test_a_figure_with_residuals_is_higher(tmp_path: Path) -> None:
    heights = []
    for name, theory in (("with", True), ("without", False)):
        draw(picture((1.0, 2.5, 0.25), (2.0, 3.0, 0.5), theory=theory), tmp_path / f"{name}.png")
        heights.append(matplotlib.image.imread(tmp_path / f"{name}.png").shape[0])
    assert heights[0] > heights[1]


@pytest.mark.parametrize("job", sorted(WHAT, key=lambda job: len(job + WHAT[job]))[-3:])
def test_the_whole_title_is_in_the_figure(job: str) -> None:
    points = (1.0, 2.5, 0.25), (2.0, 3.0, 0.5)
    figure = drawn(replace(picture(*points), title=f"{job}: {WHAT[job]}"))
    figure.draw_without_rendering()
    title = figure.axes[0].title.get_window_extent()
    assert figure.bbox.x0 <= title.x0 < title.x1 <= figure.bbox.x1
    assert title.y1 <= figure.bbox.y1
