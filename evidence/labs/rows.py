"""Published figures beside the physical layer alone: the rows of labs, and those of no lab.

Every figure is measured once, however many rows are of it.
"""

from collections.abc import Iterable, Iterator, Sequence

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.experiment import Outcome
from evidence.curves.grid import Grid, Measurer, build
from evidence.curves.parameters import Value, Values
from evidence.labs.catalogue import lab, names
from evidence.labs.lab import Finding, PublishedRow
from evidence.labs.published import PUBLISHED

Place = tuple[str, tuple[tuple[str, Value], ...]]  # an experiment, and the values of all parameters


def rows() -> list[PublishedRow]:
    return [*(row for name in names() for row in lab(name).rows), *PUBLISHED]


def points(of: Iterable[PublishedRow]) -> dict[str, list[Values]]:
    """Return what is to be measured, by experiment; raise BadGrid for what cannot be."""
    by_name: dict[str, dict[Place, Values]] = {}
    for row in of:
        for name, values in _points(row):
            by_name.setdefault(name, {})[_place(name, values)] = values
    return {name: list(places.values()) for name, places in by_name.items()}


def measured(of: Sequence[PublishedRow], seed: int, measurer: Measurer) -> Iterator[list[Finding]]:
    """Measure point by point; yield nothing new behind each, and all findings in the end."""
    outcomes: dict[Place, Outcome] = {}
    for name, values_of_points in points(of).items():
        for values, outcome in measurer(Grid(EXPERIMENTS[name], {}), values_of_points, seed):
            outcomes[_place(name, values)] = outcome
            yield []
    yield [row.finding([outcomes[_place(*point)] for point in _points(row)]) for row in of]


def _points(row: PublishedRow) -> Iterator[tuple[str, Values]]:
    for name, axes in row.points:
        yield name, next(build(EXPERIMENTS[name], axes).points())


def _place(name: str, values: Values) -> Place:
    return name, tuple(sorted(values.items()))
