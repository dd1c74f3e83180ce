"""Sweeps of jobs before their networks start: axes, groups of points, what theory says."""

from math import exp, nan
from pathlib import Path
from typing import Any

import pytest
from recorded_run import run_of, teleported

from evidence.curves import running
from evidence.curves.estimates import NOTHING, Estimate
from evidence.curves.experiment import Outcome, SweepError
from evidence.curves.grid import Grid
from evidence.curves.parameters import Values
from evidence.curves.pictures import pictures
from evidence.curves.table import opened
from evidence.networks import job_sweep, metrics
from evidence.networks.job_sweep import grid_of, options_of
from topologies.system.processes.programs import NetworkError
from wire.results.figures import MemoryFigures
from wire.results.run_result import ServiceJob

AXES: dict[str, object] = {"switches": "1:3", "node.memory.t2_s": "10ms,0.1", "count": "100:300:3"}


def sweep() -> Grid:
    return grid_of("swap", AXES)


def test_axes_are_options_and_settings_of_every_host() -> None:
    assert sweep().axes == {
        "switches": [1, 2, 3],
        "node.memory.t2_s": [0.01, 0.1],
        "count": [100, 200, 300],
    }
    axes: Values = {"schedule": "nested", "q1-q2.length_km": 5.0, "switch.insertion_loss_db": 1.0}
    options = options_of("swap", {**axes, "bob.memory.t2_s": 0.5, "purify": 1}, 7)
    assert options == {
        "seed": 7,
        "time": "stepped",
        "schedule": "nested",
        "purify": 1,
        "fiber": ["q1-q2.length_km=5.0"],
        "switch": ["insertion_loss_db=1.0"],
        "device": ["bob.memory.t2_s=0.5"],
    }


def test_axes_of_parts_come_before_those_of_the_job_in_rows_and_names() -> None:
    """As docs/researchers.md reads the table of its sweep."""
    chosen = {"count": "2", "sample": "0.5", "node.memory.t2_s": "1,2", "switches": "1:2"}
    experiment = grid_of("swap", {**chosen, "length_km": "10"}).experiment
    assert experiment.file == "swap-switches-length_km-node.memory.t2_s-count-sample"


def test_the_memories_of_all_nodes_of_a_swap_are_those_of_switches_too() -> None:
    values: Values = {"node.memory.t2_s": 0.5}
    assert options_of("swap", values, 7)["switch"] == ["memory.t2_s=0.5"]
    assert options_of("swap", values, 7)["device"] == ["*.memory.t2_s=0.5"]
    assert "switch" not in options_of("teleport", values, 7)


def test_points_that_differ_in_job_and_decays_of_memories_alone_share_a_network() -> None:
    grid = sweep()
    groups = [*grid.experiment.groups([*grid.points()], 2)]
    assert [len(group) for group in groups] == [6] * 3
    for group in groups:
        assert len({values["switches"] for values in group}) == 1
    assert job_sweep.networks_of(grid) == "a network for each switches"
    shared = ["q1.memory.t2_s", "switch.memory.cutoff_s", "bob.memory.efficiency", "count"]
    assert not [*filter(job_sweep.is_at_start, shared)]
    for own in ("node.memory.capacity", "bob.detectors.efficiency", "fiber.loss_db_per_km"):
        assert job_sweep.is_at_start(own)
    for points, at_once, wanted in (
        (9, 2, [9]),
        (10, 1, [10]),
        (10, 2, [5, 5]),
        (41, 2, [21, 20]),
        (12, 8, [6, 6]),
        (1001, 2, [334, 334, 333]),
    ):
        fractions = grid_of("qkd", {"eve": f"0:0.3:{points}"})
        groups = [*fractions.experiment.groups([*fractions.points()], at_once)]
        assert [len(each) for each in groups] == wanted
        assert [each for group in groups for each in group] == [*fractions.points()]


def test_networks_with_the_same_options_draw_other_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = grid_of("qkd", {"eve": "0:0.3:30"})
    seeds: list[int] = []

    def refuse(_job: str, _folder: Path, seed: int, **_options: Any) -> None:
        seeds.append(seed)
        raise NetworkError("no network here")

    monkeypatch.setattr(job_sweep, "start_for", refuse)
    for points in grid.experiment.groups([*grid.points()], 3):
        with pytest.raises(SweepError, match="no network here"):
            next(job_sweep.measure("qkd", points, 1, tmp_path))
    assert len({*seeds}) == 3


def test_rows_are_in_the_order_of_the_grid_though_networks_end_in_another(tmp_path: Path) -> None:
    grid = grid_of("swap", {"switches": "1:4"})
    nothing = {each.name: NOTHING for each in metrics.METRICS}
    come: list[Outcome] = [{**nothing, "fidelity": Estimate(n / 4, 0.1)} for n in range(1, 5)]

    def measurer(_grid: Grid, points: list[Values], _seed: int) -> list[tuple[Values, Outcome]]:
        return [(points[n], come[n]) for n in (2, 0, 3, 1)]

    with opened(tmp_path / "table.csv", grid.experiment) as table:
        assert len([*running.fill(grid, 1, table, measurer)]) == 4  # type: ignore[arg-type]
    lines = (tmp_path / "table.csv").read_text().splitlines()[1:]
    assert [line.split(",")[:2] for line in lines] == [["1", str(n)] for n in range(1, 5)]


@pytest.mark.parametrize("switches", [1, 4])
def test_theory_of_a_chain_is_that_of_dephasing_by_all_waits(switches: int) -> None:
    """As tests/emulation/test_run_swap.py has it; a link is one fibre, which depolarises."""
    values: Values = {"switches": switches, "depolarizing": 0.01, "node.memory.t2_s": 0.2}
    fidelity = (1 + 0.99 ** (switches + 1) * (1 + 2 * exp(-0.03 / 0.2))) / 4
    found = metrics.pair_fidelity("swap", {**values, "waiting_s": 0.03})
    assert found == pytest.approx(fidelity)
    assert metrics.pair_fidelity("swap", {**values, "waiting_s": nan}) is None
    assert metrics.pair_fidelity("swap", {**values, "preset": "metro", "waiting_s": 0.03}) is None


def test_a_figure_has_the_theory_of_each_point_by_its_measured_wait() -> None:
    grid = grid_of("swap", {"switches": "1:3", "node.memory.t2_s": "0.1"})
    nothing = {each.name: NOTHING for each in metrics.METRICS}
    rows = [
        (
            values,
            {
                **nothing,
                "waiting_s": Estimate(0.01 * int(values["switches"]), 0.0),
                "fidelity": Estimate((1 + exp(-0.1 * int(values["switches"]))) / 2, 0.01),
            },
        )
        for values in grid.points()
    ]
    assert running.disagreements(grid.experiment, rows) == []
    (picture,) = [each for each in pictures(grid, rows) if each.measure.name == "fidelity"]
    assert picture.x.name == "switches"
    ((_label, points),) = picture.series
    assert [picture.measure.theory(values) for values, _ in points] == pytest.approx(
        [estimate.value for _values, estimate in points]
    )


def test_waits_of_teleported_states_are_counted_once() -> None:
    figures = teleported(arrived=900, states=1000, fidelity=0.8, waited_ms=12.5)
    waits = sum(metrics._waits_ms(figures)) * 2  # of either end, which report the same
    assert waits == 12.5


def test_waits_in_switches_are_of_both_halves_there() -> None:
    """Each swap has two: of 3 and 4 ms at two places there are 14 ms beside 5 at this end."""
    figures = MemoryFigures(sampled_waited_ms=5.0, repeaters_waited_ms=[3.0, 4.0])
    assert sum(metrics._waits_ms(figures)) == 19


def test_memories_hold_as_many_qubits_as_all_waits_fill_the_time_of_the_job() -> None:
    """80 waits of 12.5 ms are 1 s of one qubit, in 2 s half a qubit."""
    figures = teleported(waited_ms=12.5)
    result = run_of("teleport", ServiceJob(asking=figures, asked=figures), 1.0)
    assert metrics.memory_use(result, figures, figures) == Estimate(0.5, 0.0)


def test_a_topology_with_parameters_is_axes_of_one_value() -> None:
    grid = grid_of("distribute", {"topology": "chain,switches=3", "count": "1:2"})
    assert grid.axes == {"topology": ["chain"], "switches": [3], "count": [1, 2]}
    assert job_sweep.is_at_start("switches")
