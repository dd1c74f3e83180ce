"""Whose something is: a process, by its id, when it started, and since which boot of the machine.

An id alone is given again to others. In words, as 4711-88321-1b4e28ba, an owner names the private
folder of a run, and marks its bridges and, in their environment, all its processes.
"""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from topologies.timeouts import END_TIMEOUT_S, EXEC_TIMEOUT_S, POLL_S

RUNTIME_ROOT = Path("/run/qmn")  # in which each run has a folder of its own
PROC = Path("/proc")
BOOT_ID = PROC / "sys" / "kernel" / "random" / "boot_id"
WORDS = re.compile(r"(\d+)-(\d+)-([0-9a-f]{8})")
VARIABLE = "QMN_RUN"  # in the environment of all that a run starts in its network
NAMESPACE = "QMN_PROCESSES"  # there, too: of whose processes the run is one
ENDED = "ZX"  # states of a process that only waits to be asked how it ended
STOPPED = "T"
# Flags of the kernel, of processes that have no environment: PF_EXITING and PF_KTHREAD.
WITHOUT = 0x4 | 0x20_0000
# Fields of /proc/PID/stat, counted from the state (proc(5) counts two before it).
STATE, FLAGS, USER_TICKS, SYSTEM_TICKS, START = 0, 6, 11, 12, 19
# Addresses, in the order in which a program that is loaded gets them; 0 before.
ENVIRONMENT_BEGIN, ENVIRONMENT_END, CODE = 47, 48, 23


class Owner(NamedTuple):
    """One process, for ever."""

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
        """Whether a signal has stopped it (SIGSTOP)."""
        return self.state == STOPPED

    @property
    def state(self) -> str | None:
        """The letter that the kernel gives, None for one that is gone."""
        state, start = _state_and_start(self.pid)
        return state if (start, _boot()) == (self.start, self.boot) else None

    @property
    def processor_s(self) -> float:
        """How long it has had a processor so far; 0 if it is gone."""
        try:
            fields = _fields(self.pid)
        except OSError:
            return 0
        return (int(fields[USER_TICKS]) + int(fields[SYSTEM_TICKS])) / os.sysconf("SC_CLK_TCK")

    def signal(self, number: int) -> None:
        """Send it a signal, if it is still there."""
        if self.alive:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:
                return  # it has ended meanwhile


def owner(pid: int) -> Owner | None:
    """Return the process that has this id now, None if there is none."""
    state, start = _state_and_start(pid)
    return None if state is None else Owner(pid, start, _boot())


def this_process() -> Owner:
    """Return the process that asks."""
    found = owner(os.getpid())
    assert found is not None
    return found


def from_words(words: str) -> Owner | None:
    """Return the owner that is written so, None if no owner is."""
    matched = WORDS.fullmatch(words)
    return Owner(int(matched[1]), int(matched[2]), matched[3]) if matched else None


def gone(words: str) -> bool:
    """Whether these words are those of a run that has ended; what is not ours is never gone."""
    found = from_words(words)
    return found is not None and not found.alive


def mark() -> dict[str, str]:
    """Return what this run puts into the environment of all that it starts in its network."""
    return {VARIABLE: str(this_process()), NAMESPACE: _namespace()}


def namespace() -> str:
    """Return the number of the namespace of processes that this one's id is of."""
    return "".join(filter(str.isdigit, _namespace()))


def marked() -> Iterator[tuple[Owner, str]]:
    """Yield all processes that runs have started in their networks, with the words of the run.

    Runs in a namespace of processes of their own are left out: their ids say nothing here.
    """
    here = _namespace().encode()
    for folder in PROC.iterdir():
        if not folder.name.isdigit() or (process := owner(int(folder.name))) is None:
            continue
        try:
            environment = _environment(process.pid)
        except OSError:
            continue  # it has ended, or is not ours to look into
        told = dict(entry.partition(b"=")[::2] for entry in environment.split(b"\0"))
        words = told.get(VARIABLE.encode(), b"").decode(errors="replace")
        is_here = told.get(NAMESPACE.encode(), here) == here
        if is_here and from_words(words) and process.alive:
            yield process, words


def end_marked(theirs: Callable[[str], bool]) -> None:
    """End all processes of the runs that have such words, and what these start meanwhile."""
    deadline = time.monotonic() + END_TIMEOUT_S
    while found := [process for process, words in marked() if theirs(words)]:
        end(found)
        if time.monotonic() > deadline:
            break


def end(processes: list[Owner]) -> None:
    """End processes: politely, then by force; return when they are gone."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        for process in processes:
            process.signal(number)
            process.signal(signal.SIGCONT)  # a stopped one takes no other
        deadline = time.monotonic() + END_TIMEOUT_S
        while any(process.alive for process in processes):
            if time.monotonic() > deadline:
                break
            time.sleep(POLL_S)


def _state_and_start(pid: int) -> tuple[str | None, int]:
    try:
        fields = _fields(pid)
    except OSError:
        return None, 0
    return fields[STATE], int(fields[START])


def _fields(pid: int) -> list[str]:
    return (PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()


def _environment(pid: int) -> bytes:
    """Return what a process was begun with; while it becomes another program there is none."""
    deadline = time.monotonic() + EXEC_TIMEOUT_S
    while not (environment := (PROC / str(pid) / "environ").read_bytes()):
        fields = _fields(pid)
        loaded = fields[CODE] != "0"
        has_none = loaded and fields[ENVIRONMENT_BEGIN] == fields[ENVIRONMENT_END]
        if has_none or int(fields[FLAGS]) & WITHOUT or time.monotonic() > deadline:
            break
        time.sleep(POLL_S)
    return environment


def _namespace() -> str:
    return os.readlink(PROC / "self" / "ns" / "pid")


@cache
def _boot() -> str:
    return BOOT_ID.read_text()[:8]
