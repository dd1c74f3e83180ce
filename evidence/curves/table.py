"""The CSV file of a sweep: a line a point, which a later run does not measure again."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evidence.curves import lines
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Experiment, Outcome
from evidence.curves.lines import Lines
from evidence.curves.parameters import BadGrid, Values

Key = tuple[object, ...]


class Table:
    """The measured points of an experiment; the file is appended a line at a time."""

    def __init__(self, file: Lines, experiment: Experiment) -> None:
        """Read what the file has; use `opened` for that."""
        self.path, self.cut_off = file.path, file.cut_off
        self._file, self._experiment = file, experiment
        self._known: dict[Key, Outcome] = {}
        self._read()

    def __len__(self) -> int:
        return len(self._known)

    def get(self, values: Values, seed: int) -> Outcome | None:
        return self._known.get(self._key(values, seed))

    def add(self, values: Values, seed: int, outcome: Outcome) -> None:
        """Append a point; it is on the disk when this returns."""
        row: list[object] = [seed, *(values[each.name] for each in self._experiment.parameters)]
        for measure in self._experiment.measures:
            theory = measure.expected(values, outcome)
            estimate = outcome[measure.name]
            row += [estimate.value, estimate.error, "" if theory is None else theory]
        self._file.add(row)
        self._known[self._key(values, seed)] = outcome

    def _key(self, values: Values, seed: int) -> Key:
        return (seed, *(values[each.name] for each in self._experiment.parameters))

    def _read(self) -> None:
        for number, line in enumerate(self._file.before):
            try:
                values, seed, outcome = self._parse(line)
            except (ValueError, BadGrid) as error:
                raise self._file.wrong(number, error) from error
            self._known[self._key(values, seed)] = outcome

    def _parse(self, line: list[str]) -> tuple[Values, int, Outcome]:
        experiment = self._experiment
        if len(line) != (columns := len(header(experiment))):
            raise ValueError(f"{len(line)} columns instead of {columns}")
        cells = iter(line)
        seed = int(next(cells))
        values = {each.name: each.value(next(cells)) for each in experiment.parameters}
        outcome = {}
        for measure in experiment.measures:
            value, error, _theory = next(cells), next(cells), next(cells)
            outcome[measure.name] = Estimate(float(value), float(error))
        return values, seed, outcome


def header(experiment: Experiment) -> list[str]:
    columns = ["seed", *(each.name for each in experiment.parameters)]
    for measure in experiment.measures:
        columns += [measure.name, f"{measure.name}_standard_error", f"{measure.name}_theory"]
    return columns


@contextmanager
def opened(path: Path, experiment: Experiment) -> Iterator[Table]:
    """Open or make the table; no second program may write to it meanwhile."""
    with lines.opened(path, header(experiment)) as file:
        yield Table(file, experiment)
