"""Whose something is: a process, by its id, when it started, and since which boot of the machine.

The kernel frees what is in the namespaces of a run. It does not free what is outside: groups of
hosts' memory, folders of runs and sweeps, and all that a network of `mn --custom` leaves, which has
no namespaces of its own. An owner in words, as 4711-88321-1b4e28ba, names these; an id alone is
given again to other processes.
"""

import os
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

RUNTIME_ROOT = Path("/run/qmn")  # in which each run has a folder of its own
PROC = Path("/proc")
BOOT_ID = PROC / "sys" / "kernel" / "random" / "boot_id"
WORDS = re.compile(r"(\d+)-(\d+)-([0-9a-f]{8})")
ENDED = "ZX"  # states of a process that only waits to be asked how it ended
STOPPED = "T"
# Fields of /proc/PID/stat, counted from the state (proc(5) counts two before it).
STATE, USER_TICKS, SYSTEM_TICKS, START = 0, 11, 12, 19


class Owner(NamedTuple):
    pid: int
    start: int  # clock ticks since the boot
    boot: str  # first 8 digits of its id

    def __str__(self) -> str:
        return f"{self.pid}-{self.start}-{self.boot}"

    @property
    def alive(self) -> bool:
        """Whether it still runs; one that nobody has waited for does not."""
        return self.state not in (None, *ENDED)

    @property
    def stopped(self) -> bool:
        return self.state == STOPPED

    @property
    def state(self) -> str | None:
        state, start = _state_and_start(self.pid)
        return state if (start, _boot()) == (self.start, self.boot) else None

    def signal(self, number: int) -> None:
        if self.alive:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:
                return  # it has ended meanwhile

    @property
    def processor_s(self) -> float:
        """How long it has had a processor so far; 0 if it is gone."""
        try:
            fields = _fields(self.pid)
        except OSError:
            return 0
        return (int(fields[USER_TICKS]) + int(fields[SYSTEM_TICKS])) / os.sysconf("SC_CLK_TCK")


def owner(pid: int) -> Owner | None:
    state, start = _state_and_start(pid)
    return None if state is None else Owner(pid, start, _boot())


def this_process() -> Owner:
    process = owner(os.getpid())
    assert process is not None
    return process


def from_words(words: str) -> Owner | None:
    matched = WORDS.fullmatch(words)
    return Owner(int(matched[1]), int(matched[2]), matched[3]) if matched else None


def gone(words: str) -> bool:
    """Whether these words are those of a run that has ended; what is not ours is never gone."""
    process = from_words(words)
    return process is not None and not process.alive


def namespace() -> str:
    """Return the number of the namespace of processes that this one's id is of."""
    return "".join(filter(str.isdigit, os.readlink(PROC / "self" / "ns" / "pid")))


def _state_and_start(pid: int) -> tuple[str | None, int]:
    try:
        fields = _fields(pid)
    except OSError:
        return None, 0
    return fields[STATE], int(fields[START])


def _fields(pid: int) -> list[str]:
    return (PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()


@cache
def _boot() -> str:
    return BOOT_ID.read_text()[:8]
