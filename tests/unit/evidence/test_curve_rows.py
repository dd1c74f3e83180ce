"""The rows that `qmn lab curves` prints: of each figure the point that is furthest from theory."""

import io
import math

import pytest
from rich.console import Console

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.estimates import NOTHING, Estimate
from evidence.curves.grid import Row
from evidence.curves.sheets import Curve, Sheet
from evidence.kinds.curves import furthest
from evidence.labs.outcome import show

AXES: dict[str, object] = {"fidelity": "0.7:0.9:2"}
CURVE = Curve("figure", "Teleportation", "fidelity", "F", "teleported")
SHEET = Sheet("sheet", "teleport", AXES, [CURVE])


def row(fidelity: float, ours: Estimate) -> Row:
    """Return a point: teleportation over Werner pairs comes out with (2F + 1)/3."""
    return EXPERIMENTS["teleport"].complete({"fidelity": fidelity}), {"teleported": ours}


def test_the_point_furthest_from_theory_is_printed_with_the_difference() -> None:
    """(2 .7 + 1)/3 = .8, two errors below ours; (2 .9 + 1)/3 = .9333, one above."""
    rows = [row(0.7, Estimate(0.804, 0.002)), row(0.9, Estimate(0.93233, 0.001))]
    (finding,) = furthest(SHEET, [*rows, row(0.8, NOTHING)])
    assert finding.difference == pytest.approx(2.0)
    text = io.StringIO()
    show(Console(file=text, width=200), [finding], 5, "theory")
    head, line = text.getvalue().splitlines()
    assert head.split()[:3] == ["this", "model", "theory"]
    assert line.split("  ")[0] == "Teleportation"
    assert "0.8040 ± 0.0020" in line
    assert "+2.0" in line
    assert "fidelity" in line


def test_a_figure_without_what_was_counted_has_no_row() -> None:
    rows = [row(0.7, Estimate(0.8, 0.0)), row(0.9, Estimate(math.nan, math.nan))]
    assert furthest(SHEET, rows) == []
