"""The runs of a lab that have gone well, by a table in its folder: `--resume` omits them."""

import csv
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from evidence.curves import lines
from evidence.curves.lines import Lines
from evidence.labs.lab import Lab, Run
from evidence.labs.networks import left_in

TABLE = "runs.csv"
COLUMNS = ("run", "seed", "command", "folder")  # the words behind `qmn`; below the lab's


class RunsDone:
    """The runs with a seed that are done; the file is appended a line at a time."""

    def __init__(self, file: Lines, lab: Lab, seed: int) -> None:
        """Read what the file has; use `opened` for that."""
        self._file, self._lab, self._seed = file, lab, seed
        self._known: dict[str, Path] = {}
        for number, line in enumerate(file.before):
            if len(line) != len(COLUMNS):
                text = f"{len(line)} columns instead of {len(COLUMNS)}"
                raise file.wrong(number, ValueError(text))
            run, seeded, command, folder = line
            if (seeded, command) == (str(seed), lab.runs.get(run)):
                self._known[run] = file.path.parent / folder

    @property
    def missing(self) -> list[str]:
        return [run for run in self._lab.runs if run not in self._known]

    def get(self, run: str) -> Run | None:
        folder = self._known.get(run)
        return None if folder is None else left_in(folder)

    def add(self, name: str, run: Run) -> None:
        """Append a run; it is on the disk when this returns."""
        folder = run.folder.relative_to(self._file.path.parent.resolve())
        self._file.add((name, self._seed, self._lab.runs[name], folder))
        self._known[name] = run.folder


@contextmanager
def opened(folder: Path, lab: Lab, seed: int) -> Iterator[RunsDone]:
    """Open or make the table of a lab's folder; no second program may write to it meanwhile."""
    with lines.opened(folder / TABLE, COLUMNS) as file:
        yield RunsDone(file, lab, seed)


def newest(out: Path, name: str, seed: int) -> Path | None:
    mine = re.compile(rf"(\d{{8}}T\d{{6}})-{re.escape(name)}(?:-(\d+))?")
    by_date = {}
    for path in out.resolve().iterdir() if out.exists() else ():
        match = mine.fullmatch(path.name)
        if match and (path / TABLE).exists() and seeds(path / TABLE) <= {str(seed)}:
            by_date[match[1], int(match[2] or 0)] = path
    return by_date[max(by_date)] if by_date else None


def seeds(table: Path) -> set[str]:
    with table.open(newline="") as file:
        return {line["seed"] or "" for line in csv.DictReader(file, COLUMNS)} - {"seed"}
