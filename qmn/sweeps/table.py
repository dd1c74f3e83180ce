"""The CSV file of a sweep: a line a point, which a later run does not measure again."""

import csv
import fcntl
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from qmn.sweeps.estimates import Estimate
from qmn.sweeps.experiment import Experiment, Outcome
from qmn.sweeps.parameters import BadGrid, Values

Key = tuple[object, ...]


class BadTable(Exception):
    """A file that is not a table of this experiment; the message says what to do."""


class Table:
    """What is known of the points of an experiment; the file is appended a line at a time."""

    def __init__(self, path: Path, experiment: Experiment, descriptor: int) -> None:
        """Read what the open file has; use `opened` for that."""
        self.path, self._experiment, self._descriptor = path, experiment, descriptor
        self._known: dict[Key, Outcome] = {}
        self.cut_off = self._cut_half_line()
        self._read()

    def __len__(self) -> int:
        """Return how many points are known, of whichever grid and seed."""
        return len(self._known)

    def get(self, values: Values, seed: int) -> Outcome | None:
        """Return the outcome at a point, None if it is not known."""
        return self._known.get(self._key(values, seed))

    def add(self, values: Values, seed: int, outcome: Outcome) -> None:
        """Append a point; it is on the disk when this returns."""
        said = {**values, **dict.fromkeys(self._experiment.unsaid(values), "")}
        row: list[object] = [seed, *(said[each.name] for each in self._experiment.parameters)]
        for measure in self._experiment.measures:
            theory = measure.expected(values, outcome)
            estimate = outcome[measure.name]
            row += [estimate.value, estimate.error, "" if theory is None else theory]
        self._append(row)
        self._known[self._key(values, seed)] = outcome

    def _key(self, values: Values, seed: int) -> Key:
        return (seed, *(values[each.name] for each in self._experiment.parameters))

    def _header(self) -> list[str]:
        columns = ["seed", *(each.name for each in self._experiment.parameters)]
        for measure in self._experiment.measures:
            columns += [measure.name, f"{measure.name}_standard_error", f"{measure.name}_theory"]
        return columns

    def _cut_half_line(self) -> bool:
        """Drop a last line without an end, which an interrupted write has left."""
        content = self.path.read_bytes()
        end = content.rfind(b"\n") + 1
        os.ftruncate(self._descriptor, end)
        return end < len(content)

    def _read(self) -> None:
        lines = list(csv.reader(io.StringIO(self.path.read_text(errors="replace"))))
        if not lines:
            self._append(self._header())
            return
        if lines[0] != self._header():
            raise BadTable(
                f"{self.path} has other columns than this sweep: take another --out, or remove it"
            )
        for place, line in enumerate(lines[1:], start=2):
            try:
                values, seed, outcome = self._parse(line)
            except (ValueError, BadGrid) as error:
                raise BadTable(f"{self.path}, line {place}: {error}; remove the line") from error
            self._known[self._key(values, seed)] = outcome

    def _parse(self, line: list[str]) -> tuple[Values, int, Outcome]:
        experiment = self._experiment
        if len(line) != len(self._header()):
            raise ValueError(f"{len(line)} columns instead of {len(self._header())}")
        own = iter(line)
        seed = int(next(own))
        said = {each.name: next(own) for each in experiment.parameters}
        values = {
            each.name: each.value(said[each.name]) if said[each.name] else each.default
            for each in experiment.parameters
        }
        empty = {name for name, text in said.items() if not text and values[name] != ""}
        if wrong := empty.difference(experiment.unsaid(values)):
            raise ValueError(f"{min(wrong)} is empty")
        outcome = {}
        for measure in experiment.measures:
            value, error, _theory = next(own), next(own), next(own)
            outcome[measure.name] = Estimate(float(value), float(error))
        return values, seed, outcome

    def _append(self, row: Sequence[object]) -> None:
        """Write a line in one piece."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(row)
        line = text.getvalue().encode()
        written = os.write(self._descriptor, line)
        if written != len(line):
            raise BadTable(f"{self.path}: the disk is full; make room and run again")
        os.fsync(self._descriptor)


@contextmanager
def opened(path: Path, experiment: Experiment) -> Iterator[Table]:
    """Open or make the table; no second program may write to it meanwhile."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise BadTable(f"cannot write {path}: {error.strerror}") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BadTable(f"another sweep writes to {path}: take another --out") from error
        yield Table(path, experiment, descriptor)
    finally:
        os.close(descriptor)
