"""A CSV file of what is done: a line each, which a later run reads and does not do again."""

import csv
import fcntl
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


class BadTable(Exception):
    """A file that is not the table it should be; the message says what to do."""


class Lines:
    """The lines below a header; each that is added is on the disk when that returns."""

    def __init__(self, path: Path, header: Sequence[str], descriptor: int) -> None:
        """Read what the open file has; use `opened` for that."""
        self.path, self._descriptor = path, descriptor
        self.cut_off = self._cut_half_line()
        lines = list(csv.reader(io.StringIO(path.read_text(errors="replace"))))
        if not lines:
            self.add(header)
        elif lines[0] != list(header):
            raise BadTable(f"{path} has other columns than this: take another --out, or remove it")
        self.before = lines[1:]

    def _cut_half_line(self) -> bool:
        """Drop a last line without an end, which an interrupted write has left."""
        content = self.path.read_bytes()
        end = content.rfind(b"\n") + 1
        os.ftruncate(self._descriptor, end)
        return end < len(content)

    def add(self, row: Sequence[object]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(row)
        line = text.getvalue().encode()
        written = os.write(self._descriptor, line)
        if written != len(line):
            raise BadTable(f"{self.path}: the disk is full; make room and run again")
        os.fsync(self._descriptor)

    def wrong(self, number: int, error: Exception) -> BadTable:
        """Return what to raise for a line of `before` that cannot be, by its place in that."""
        return BadTable(f"{self.path}, line {number + 2}: {error}; remove the line")


@contextmanager
def opened(path: Path, header: Sequence[str]) -> Iterator[Lines]:
    """Open or make the file; no second program may write to it meanwhile."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise BadTable(f"cannot write {path}: {error.strerror}") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BadTable(f"another qmn writes to {path}: take another --out") from error
        yield Lines(path, header, descriptor)
    finally:
        os.close(descriptor)
