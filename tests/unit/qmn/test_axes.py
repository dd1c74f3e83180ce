"""Axes of charts: where values are, which ticks there are, what numbers are called."""

import re
from math import log10

import pytest

from qmn.reports.axes import Axes, Frame, engineering, round_values
from qmn.reports.drawing import INK, POINTS, Drawing

FRAME = Frame(left=1.0, top=0.5, right=4.0, bottom=2.5)


def test_ends_of_axes_are_the_corners_and_values_between_are_in_proportion() -> None:
    axes = Axes(Drawing(5, 3), FRAME, (10, 40), (0, 8))
    assert axes.at(10, 0) == (1.0, 2.5)
    assert axes.at(40, 8) == (4.0, 0.5)
    assert axes.at(20, 2) == pytest.approx((2.0, 2.0))


def test_a_scale_is_applied_to_y_alone() -> None:
    axes = Axes(Drawing(5, 3), FRAME, (1, 100), (1, 100), log10)
    assert axes.at(50.5, 10) == pytest.approx((2.5, 1.5))


@pytest.mark.parametrize(
    ("ends", "most", "expected"),
    [
        ((0, 1), 5, [0, 0.2, 0.4, 0.6, 0.8, 1]),
        ((0, 150), 6, [0, 50, 100, 150]),
        ((0, 0.0276), 6, [0, 0.005, 0.01, 0.015, 0.02, 0.025]),
        ((-3, 7), 5, [-2, 0, 2, 4, 6]),
        ((9_500, 10_500), 2, [9_500, 10_000, 10_500]),
    ],
)
def test_ticks_are_multiples_of_one_two_or_five_powers_of_ten(
    ends: tuple[float, float], most: int, expected: list[float]
) -> None:
    assert round_values(*ends, most) == pytest.approx(expected)


def test_counts_have_whole_ticks() -> None:
    assert round_values(0, 2.2, 6, whole=True) == [0, 1, 2]
    assert round_values(0, 2.2, 6)[1] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0, "s", "0 s"),
        (0.0003, "s", "300 µs"),
        (0.001, "s", "1 ms"),
        (1.5, "s", "1.5 s"),
        (999, "", "999"),
        (1_000, "", "1 k"),
        (2_500_000, "", "2.5 M"),
        (-20_000, "", "-20 k"),
    ],
)
def test_numbers_have_the_prefixes_of_the_si(value: float, unit: str, text: str) -> None:
    assert engineering(value, unit) == text


def test_steps_hold_each_value_until_the_next() -> None:
    drawing = Drawing(5, 3)
    Axes(drawing, Frame(0, 0, 3, 2), (0, 3), (0, 2)).steps([0, 1, 3], [0, 2, 1], INK)
    (path,) = re.findall(r'd="M ([^"]+)"', drawing.svg("steps"))
    places = [tuple(float(n) / POINTS for n in each.split()) for each in path.split(" L ")]
    # Down is larger in a drawing: 0 is at its foot, 2 inches below its top.
    assert places == [(0, 2), (1, 2), (1, 0), (3, 0), (3, 1)]


def test_words_are_no_markup() -> None:
    drawing = Drawing(1, 1)
    drawing.text((0.5, 0.5), 'a <b> & "c"')
    drawn = drawing.svg('of "a" & <b>')
    assert 'a &lt;b&gt; &amp; "c"</text>' in drawn
    assert 'aria-label="of &quot;a&quot; &amp; &lt;b&gt;"' in drawn
