"""Whether any task of this process namespace runs, or can run, by what the kernel counts of each.

Nothing runs if each task sleeps and has had no time slice from a look before to one behind that:
what had been woken, and slept again when it was looked at, would have had one. Packets that the
kernel has not handed on yet count as running. Threads of gRPC do not, which wake several times a
second without work: what they carry is counted (wire.network_time.LinkCounts), or who waits for it
holds time.
"""

import os
from collections.abc import Iterator
from typing import NamedTuple, Self

STAT_BYTES = 512
RUNS = b"RD"  # states of a task: on a processor or waiting for one, and waiting for a disk
CARRIERS = ("event_engine", "grpc_global_tim", "lifeguard")  # gRPC's threads
BUSIEST = 4  # tasks that were found running last: a look at all costs ten times as much
BACKLOG = 11  # field of softnet_stat, in hexadecimal


class Task(NamedTuple):
    """The kernel's files of one thread."""

    stat: int
    schedstat: int

    @classmethod
    def opened(cls, folder: str) -> Self:
        """Open the files; raise OSError if the thread has ended."""
        stat = os.open(f"{folder}/stat", os.O_RDONLY)
        try:
            return cls(stat, os.open(f"{folder}/schedstat", os.O_RDONLY))
        except OSError:
            os.close(stat)
            raise

    def close(self) -> None:
        """Close the files."""
        os.close(self.stat)
        os.close(self.schedstat)

    @property
    def name(self) -> str:
        """The thread's id and the name of its program; raise OSError if it has ended."""
        stat = os.pread(self.stat, STAT_BYTES, 0)
        return stat[: stat.rindex(b")") + 1].decode(errors="replace")

    @property
    def is_carrier(self) -> bool:
        """Whether it is a thread of gRPC; raise OSError if it has ended."""
        return self.name.partition("(")[2][:-1] in CARRIERS

    @property
    def runs(self) -> bool:
        """Whether the thread runs or could; raise OSError if it has ended."""
        stat = os.pread(self.stat, STAT_BYTES, 0)
        return stat[stat.rindex(b")") + 2] in RUNS

    @property
    def slices(self) -> bytes:
        """How long and how often the thread has run; raise OSError if it has ended."""
        return os.pread(self.schedstat, STAT_BYTES, 0)


class Quiescence:
    """Looks at all tasks of the namespace except those of this process."""

    def __init__(self, proc: str = "/proc") -> None:
        self._proc = proc
        self._tasks: list[Task] = []
        self._newest = b""  # process id of the newest task when the list was made
        self._load = os.open(f"{proc}/loadavg", os.O_RDONLY)
        self._softnet = os.open(f"{proc}/net/softnet_stat", os.O_RDONLY)

    def __bool__(self) -> bool:
        """Return whether nothing runs now."""
        if (newest := self._newest_id()) != self._newest:
            self._find_tasks()
            self._newest = newest
        try:
            if self._runs(BUSIEST):
                return False
            before = self._slices()
            if self._backlog() or self._runs():
                return False
            return before == self._slices() and newest == self._newest_id()
        except ProcessLookupError:
            self._newest = b""
            return False

    @property
    def holder(self) -> str:
        """The task that was found running last, if it still runs, by name and process id."""
        try:
            task = self._tasks[0] if self._tasks and self._tasks[0].runs else None
            return task.name if task else ""
        except ProcessLookupError:
            return ""

    def _newest_id(self) -> bytes:
        return os.pread(self._load, STAT_BYTES, 0).split()[-1]

    def _slices(self) -> list[bytes]:
        return [task.slices for task in self._tasks]

    def _runs(self, first: int | None = None) -> bool:
        """Return whether one of the first tasks runs, or any."""
        for position, task in enumerate(self._tasks[:first]):
            if task.runs:
                self._tasks.insert(0, self._tasks.pop(position))  # it may run for a while
                return True
        return False

    def _backlog(self) -> bool:
        lines = os.pread(self._softnet, 1 << 16, 0).splitlines()
        return any(int(line.split()[BACKLOG], 16) for line in lines)

    def _find_tasks(self) -> None:
        for task in self._tasks:
            task.close()
        self._tasks = list(_tasks(self._proc))


def _tasks(proc: str) -> Iterator[Task]:
    this_process = str(os.getpid())
    for process in os.listdir(proc):
        if not process.isdecimal() or process == this_process:
            continue
        try:
            for thread in os.listdir(f"{proc}/{process}/task"):
                task = Task.opened(f"{proc}/{process}/task/{thread}")
                if task.is_carrier:
                    task.close()
                else:
                    yield task
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended meanwhile
