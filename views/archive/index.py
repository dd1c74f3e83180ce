"""The runs of a folder, in a table of SQLite beside them that is made again if it is lost.

The table follows from the folders alone. A run is read again when its result has
changed, and leaves the table when its folder has gone.
"""

import json
import os
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from qmn.network.options import NetworkOptions
from qmn.requests.kinds import RECORDED_REQUESTS, job_of
from qmn.results.run_folder import give
from qmn.running.network import left_of_killed
from views.archive.named_run import is_run, stamp_of
from wire.malformed import MalformedPacket
from wire.results import schema
from wire.results.run_result import BEGUN, RESULT, Head, Parameter

INDEX = ".index.sqlite"
COLUMNS = (
    "name TEXT PRIMARY KEY, result_ns INTEGER, began TEXT, what TEXT, changed TEXT, outcome TEXT, "
    "bytes INTEGER"
)
BEGAN = "%Y-%m-%d %H:%M:%S"
ALWAYS = ("sender", "receiver", "opener", "acceptor")  # who, not how


@dataclass(frozen=True)
class Run:
    name: str
    result_ns: int  # when the result was written; 0: there is none
    began: str  # BEGAN
    what: str  # service and topology
    changed: str  # parameters that are not the default, as JSON
    outcome: str  # done, not done: …, no result, not readable: …
    bytes: int  # of all its files

    @property
    def parameters(self) -> dict[str, Any]:
        values: dict[str, Any] = json.loads(self.changed)
        return values


def runs_in(folder: Path) -> list[Run]:
    """Return the runs of a folder, oldest first, and bring its index up to date.

    Raise OSError if the folder cannot be read.
    """
    paths = {path.name: path for path in folder.iterdir() if is_run(path)}
    with _opened(folder / INDEX) as index:
        indexed = {row[0]: Run(*row) for row in index.execute("SELECT * FROM runs")}
        stale = [
            name
            for name, path in paths.items()
            if name not in indexed
            or indexed[name].result_ns != _result_ns(path)
            or not _result_ns(path)
        ]
        gone = [(name,) for name in indexed if name not in paths]
        index.executemany("DELETE FROM runs WHERE name = ?", gone)
        made = {name: read_run(paths[name]) for name in stale}
        _store(index, made.values())
    current = {**{name: run for name, run in indexed.items() if name in paths}, **made}
    return sorted(current.values(), key=lambda run: (run.began, run.name))


def read_run(path: Path) -> Run:
    began = time.strftime(BEGAN, stamp_of(path.name))
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    try:
        killed = left_of_killed(path)
        head = schema.head_of(killed) if killed else schema.read_head(path)
    except (OSError, MalformedPacket) as error:
        return Run(
            path.name, _result_ns(path), began, path.name[16:], "{}", _none(path, error), size
        )
    what = " ".join(filter(None, [head.service or "network", head.topology]))
    changed = json.dumps(differing(head))
    return Run(path.name, _result_ns(path), began, what, changed, outcome(head), size)


def _none(path: Path, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "goes on" if (path / BEGUN).exists() else "no result"
    if isinstance(error, PermissionError):
        return f"not readable: it is of user {path.stat().st_uid}"
    return f"not readable: {error}"


def differing(head: Head) -> dict[str, Parameter]:
    """Return the parameters of a run that say something: those that are not the default."""
    defaults = _defaults(head)
    values = {"controller": head.controller, "seed": head.seed, **head.parameters}
    return {
        name: value
        for name, value in values.items()
        if name not in ALWAYS
        and value is not None
        and value not in ([], "")
        and not (name in defaults and value == defaults[name])
    }


def _defaults(head: Head) -> dict[str, Any]:
    options = {field.name: field for field in fields(NetworkOptions)}
    if entry := RECORDED_REQUESTS.get(job_of(head.service or "", head.job)):
        options |= entry.fields
    return {name: each.default for name, each in options.items()}


def outcome(head: Head) -> str:
    if head.error:
        return f"not done: {head.error}"
    return {True: "done", False: "not done", None: "ended"}[head.delivered]


def _result_ns(path: Path) -> int:
    file = path / RESULT
    return file.stat().st_mtime_ns if file.exists() else 0


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """Open the index, a new one if the file is none; one that cannot be written is not kept."""
    writable = os.access(file if file.exists() else file.parent, os.W_OK)
    index = _connected(file if writable else Path(":memory:"))
    try:
        with index:
            yield index
    finally:
        index.close()
    if writable:
        give(file)


def _connected(file: Path) -> sqlite3.Connection:
    index = sqlite3.connect(file)
    try:
        index.execute(f"CREATE TABLE IF NOT EXISTS runs ({COLUMNS})")
        columns = [row[1] for row in index.execute("PRAGMA table_info(runs)")]
    except sqlite3.DatabaseError:
        columns = []
    if columns == [field.name for field in fields(Run)]:
        return index
    index.close()
    file.unlink()
    return _connected(file)


def _store(index: sqlite3.Connection, runs: Iterable[Run]) -> None:
    names = [field.name for field in fields(Run)]
    marks = ", ".join(f":{name}" for name in names)
    index.executemany(f"INSERT OR REPLACE INTO runs VALUES ({marks})", map(asdict, runs))  # noqa: S608
