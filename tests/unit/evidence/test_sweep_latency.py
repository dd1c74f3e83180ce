"""Fidelity over a measured latency, which theory takes, wherever it is compared."""

import csv
import math
from pathlib import Path

import matplotlib.image
import pytest
from recorded_run import teleported

from evidence.curves import running, theory
from evidence.curves.estimates import NOTHING, Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.figure import draw
from evidence.curves.grid import Row, build
from evidence.curves.pictures import pictures
from evidence.curves.table import opened
from evidence.networks.catalogue import EMULATED
from evidence.networks.teleportation import WAITED, outcome, request
from qmn.jobs import counted_service

TELEPORT = EMULATED["teleport"]
T1_S, T2_S, P = 0.5, 0.2, 0.02
GRID = build(
    TELEPORT,
    {
        "copper_mbps": [0.2, 1.0, 20.0],
        "memory_t1_s": T1_S,
        "memory_t2_s": T2_S,
        "depolarizing": P,
        "state": ["random", "haar"],
    },
)


def fidelity(waited_s: float) -> float:
    """Return it of halves of pairs whose photons have passed four noisy fibres."""
    kept = (1 - P) ** 4
    return 1 / 2 + kept * (2 * math.exp(-waited_s / T2_S) + math.exp(-waited_s / T1_S)) / 6


def waits(rate_mbps: float) -> float:
    return 0.05 / rate_mbps + 0.01


def measured(waited_s: float, off: float = 0.0) -> Outcome:
    return {
        WAITED.name: Estimate(waited_s, 0.0),
        "teleported": Estimate(fidelity(waited_s) + off, 0.001),
    }


def rows() -> list[Row]:
    """Return points as theory has them; at the fastest channel nothing has arrived."""
    found: list[Row] = []
    for values in GRID.points():
        rate = float(values["copper_mbps"])
        nothing = {WAITED.name: NOTHING, "teleported": NOTHING}
        found.append((values, nothing if rate == 20 else measured(waits(rate))))
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
    assert running.disagreements(TELEPORT, rows()) == []
    (values, _outcome), *others = rows()
    (text,) = running.disagreements(TELEPORT, [(values, measured(0.1, off=0.006)), *others])
    assert "copper_mbps 0.2" in text
    assert f"theory {fidelity(0.1):.6g}" in text


def test_the_table_has_the_theory_of_the_measured_wait(tmp_path: Path) -> None:
    values = next(GRID.points())
    outcome = measured(0.25)
    with opened(tmp_path / "teleport.csv", TELEPORT) as table:
        table.add(values, 1, outcome)
    with (tmp_path / "teleport.csv").open() as file:
        (line,) = csv.DictReader(file)
    assert float(line["teleported_theory"]) == pytest.approx(fidelity(0.25))
    with opened(tmp_path / "teleport.csv", TELEPORT) as table:
        assert table.get(values, 1) == outcome


def test_the_figure_has_the_measured_wait_as_its_axis(tmp_path: Path) -> None:
    by_rate, by_wait = pictures(GRID, rows())
    assert (by_rate.x.name, by_rate.measure.name) == ("copper_mbps", WAITED.name)
    assert (by_wait.x.name, by_wait.measure.name) == (WAITED.name, "teleported")
    assert by_wait.x_label == "measured wait in memory for the two bits (s)"
    assert [label for label, _points in by_wait.series] == ["state random", "state haar"]
    for _label, points in by_wait.series:
        places = [values[WAITED.name] for values, _estimate in points]
        assert places == [waits(0.2), waits(1.0)]  # what has not arrived has no place
        for values, estimate in points:
            assert by_wait.measure.theory(values) == pytest.approx(estimate.value)
    draw(by_wait, tmp_path / "figure.png")
    assert matplotlib.image.imread(tmp_path / "figure.png").std() > 0.05


@pytest.mark.parametrize(("state", "backend"), [("random", "chp"), ("haar", "dense")])
def test_a_point_is_what_qmn_run_can_be_told(tmp_path: Path, state: str, backend: str) -> None:
    values = TELEPORT.complete({"state": state, "copper_mbps": 0.5, "memory_t2_s": T2_S})
    asked = request(values, 7, tmp_path)
    network = asked.network
    assert (network.copper_mbps, network.backend, network.seed) == (0.5, backend, 7)
    assert network.device == ("bob.memory.t1_s=inf", f"bob.memory.t2_s={T2_S}")
    options = counted_service.checked(asked)[0].options
    assert options.count == options.block_pairs  # all in one block


def test_what_a_run_says_is_counted() -> None:
    told = teleported(arrived=900, states=1000, fidelity=0.8, waited_ms=12.5)
    assert outcome(told)["teleported"].value == 0.8
    assert outcome(told)[WAITED.name] == Estimate(0.0125, 0.0)
    lost = outcome(teleported(arrived=0, fidelity=None, waited_ms=None))
    assert all(math.isnan(estimate.value) for estimate in lost.values())
