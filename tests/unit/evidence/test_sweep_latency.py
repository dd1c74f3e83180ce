"""Fidelity over a measured latency, which theory takes, wherever it is compared."""

import csv
import math
from pathlib import Path

import matplotlib.image
import pytest

from evidence.curves import running, theory
from evidence.curves.estimates import NOTHING, Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.figure import draw
from evidence.curves.grid import Row, build
from evidence.curves.pictures import pictures
from evidence.curves.table import opened
from evidence.networks.congestion import CONGESTION, WAITED

T1_S, T2_S = 0.5, 0.2
GRID = build(
    CONGESTION,
    {"copper_mbps": [0.2, 1.0, 10.0], "memory_t2_s": T2_S, "frame_bytes": [500, 1250]},
)


OTHERS = "queued", "wait", "fidelity"  # measures of the demo


def fidelity(waited_s: float) -> float:
    """Return it of halves that have dephased."""
    return 1 / 2 + (2 * math.exp(-waited_s / T2_S) + 1) / 6


def waits(rate_mbps: float) -> float:
    return 0.05 / rate_mbps + 0.01


def measured(waited_s: float, off: float = 0.0) -> Outcome:
    return {
        WAITED.name: Estimate(waited_s, 0.0),
        "teleported": Estimate(fidelity(waited_s) + off, 0.001),
        **dict.fromkeys(OTHERS, NOTHING),
    }


def rows() -> list[Row]:
    """Return points as theory has them; at the fastest channel nothing has arrived."""
    found: list[Row] = []
    for values in GRID.points():
        rate = float(values["copper_mbps"])
        nothing = dict.fromkeys((WAITED.name, "teleported", *OTHERS), NOTHING)
        found.append((values, nothing if rate == 10 else measured(waits(rate))))
    return found


def test_theory_without_waiting_and_without_end() -> None:
    assert theory.waited_fidelity(0, T1_S, T2_S, 0) == 1
    assert theory.waited_fidelity(1e9, T1_S, T2_S, 0) == 1 / 2
    assert theory.waited_fidelity(1, math.inf, math.inf, 0) == 1
    assert theory.waited_fidelity(1e9, math.inf, T2_S, 0) == pytest.approx(2 / 3)
    pair = 0.9  # a Werner pair depolarises with 4 (1 - F) / 3
    assert theory.waited_fidelity(0, T1_S, T2_S, theory.of_fidelity(pair)) == pytest.approx(
        theory.teleported_fidelity(pair)
    )


def test_points_agree_by_the_wait_that_was_measured_and_not_by_the_rate() -> None:
    assert running.disagreements(CONGESTION, rows()) == []
    (values, _outcome), *others = rows()
    (text,) = running.disagreements(CONGESTION, [(values, measured(0.1, off=0.006)), *others])
    assert "copper_mbps 0.2" in text
    assert f"theory {fidelity(0.1):.6g}" in text


def test_the_table_has_the_theory_of_the_measured_wait(tmp_path: Path) -> None:
    values = next(GRID.points())
    outcome = measured(0.25)
    with opened(tmp_path / "sweep.csv", CONGESTION) as table:
        table.add(values, 1, outcome)
    with (tmp_path / "sweep.csv").open() as file:
        (line,) = csv.DictReader(file)
    assert float(line["teleported_theory"]) == pytest.approx(fidelity(0.25))
    with opened(tmp_path / "sweep.csv", CONGESTION) as table:
        known = table.get(values, 1)
    assert known is not None
    assert known["teleported"] == outcome["teleported"]


def test_the_figure_has_the_measured_wait_as_its_axis(tmp_path: Path) -> None:
    by_rate, by_wait = pictures(GRID, rows())
    assert (by_rate.x.name, by_rate.measure.name) == ("copper_mbps", WAITED.name)
    assert (by_wait.x.name, by_wait.measure.name) == (WAITED.name, "teleported")
    assert by_wait.x_label == "wait in memory for the two bits, as dephasing averages it (s)"
    assert [label for label, _points in by_wait.series] == ["frame bytes 500", "frame bytes 1250"]
    for _label, points in by_wait.series:
        places = [values[WAITED.name] for values, _estimate in points]
        assert places == [waits(0.2), waits(1.0)]  # what has not arrived has no place
        for values, estimate in points:
            assert by_wait.measure.theory(values) == pytest.approx(estimate.value)
    draw(by_wait, tmp_path / "figure.png")
    assert matplotlib.image.imread(tmp_path / "figure.png").std() > 0.05
