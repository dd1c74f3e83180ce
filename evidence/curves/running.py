"""A sweep from its grid to its rows: what is known already, what is measured, what theory says."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager

from distributed import Client

from evidence.curves import catalogue, cluster
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Experiment, Outcome
from evidence.curves.grid import Grid, Measurer, Row
from evidence.curves.parameters import Value, Values
from evidence.curves.table import Table


def missing(grid: Grid, seed: int, table: Table) -> list[Values]:
    return [values for values in grid.points() if table.get(values, seed) is None]


def fill(grid: Grid, seed: int, table: Table, measurer: Measurer) -> Iterator[Row]:
    """Measure what is missing; yield each point as it comes.

    The table has them in the grid's order, unless the sweep is interrupted.
    """
    points = deque(missing(grid, seed, table))
    come: dict[tuple[Value, ...], Outcome] = {}  # and not in the table yet
    try:
        for values, outcome in measurer(grid, list(points), seed):
            come[tuple(values.values())] = outcome
            while points and (key := tuple(points[0].values())) in come:
                table.add(points.popleft(), seed, come.pop(key))
            yield values, outcome
    finally:
        for values in points:
            if (key := tuple(values.values())) in come:
                table.add(values, seed, come[key])


def rows(grid: Grid, seed: int, table: Table) -> list[Row]:
    """Return all points of the grid that are in the table, in the grid's order."""
    outcomes = ((values, table.get(values, seed)) for values in grid.points())
    return [(values, outcome) for values, outcome in outcomes if outcome is not None]


def on_cluster(
    client: Client, check: Callable[[], None], measure: cluster.Task = catalogue.measure
) -> Measurer:
    """Return what measures points with Dask; `check` may end it by raising."""

    def measurer(grid: Grid, points: Sequence[Values], seed: int) -> Iterator[Row]:
        for values, numbers in cluster.measured(
            client, grid.experiment, points, seed, check, measure
        ):
            yield values, estimates(numbers)

    return measurer


def estimates(measured: cluster.Measured) -> Outcome:
    return {name: Estimate(*numbers) for name, numbers in measured.items()}


def client(scheduler: str, workers: int) -> AbstractContextManager[Client]:
    return cluster.remote_client(scheduler) if scheduler else cluster.local_client(workers)


def disagreements(experiment: Experiment, measured: Iterable[Row]) -> list[str]:
    """Name every point that is too far from theory.

    Left out is what has no theory, and what could not be measured, as errors of lost light.
    """
    far = []
    for values, outcome in measured:
        for measure in experiment.measures:
            theory, estimate = measure.expected(values, outcome), outcome[measure.name]
            if theory is None or math.isnan(estimate.value) or estimate.agrees(theory):
                continue
            far.append(
                f"{experiment.place(values)}: {measure.name} {estimate.value:.6g} "
                f"+- {estimate.error:.2g}, theory {theory:.6g}"
            )
    return far
