"""The memory that the programs which people start on a host may take: a share of this machine.

Each process may take so much for its data (RLIMIT_DATA): more is refused to it. Where the kernel
lets a group of processes be made (cgroup, version 1 or 2, seldom in a container), all of a host
may take so much together: who takes more then is killed. Our own programs are in no group.

    /sys/fs/cgroup/memory/<our own group>/qmn.<keeper>.alice    version 1
    /sys/fs/cgroup/qmn.<keeper>.alice                           version 2
"""

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

from topologies.system import namespaces
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import END_TIMEOUT_S, POLL_S
from wire.parameters.physics import BadParameter

KIB, MIB = 1 << 10, 1 << 20
LEAST_MIB = 64  # a shell, and what it starts
PREFIX = "qmn"
OWN_GROUPS = Path("/proc/self/cgroup")
TOP = Path("/sys/fs/cgroup")
KILLED = "oom_kill "  # a line of what tells of it


class Version(NamedTuple):
    limit: str
    events: str
    swap: str  # where the kernel counts it, or else none
    counts_both: bool  # whether that one limits memory and swap together


V1 = Version("memory.limit_in_bytes", "memory.oom_control", "memory.memsw.limit_in_bytes", True)
V2 = Version("memory.max", "memory.events", "memory.swap.max", False)


def default_mib() -> int:
    """Return what a host may take if nobody says: half of this machine's memory."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2 // MIB


def checked_mib(host: str, mib: object) -> int:
    """Return how much a host may take; raise BadParameter for what cannot be."""
    if mib is None:
        return default_mib()
    if isinstance(mib, bool) or not isinstance(mib, int) or mib < LEAST_MIB:
        raise BadParameter(
            f"{host}: memory_mib {mib!r} is not a whole number of at least {LEAST_MIB}"
        )
    return mib


def parent() -> tuple[Path, Version] | None:
    """Return below which group others can be made that limit memory; None: below none."""
    for line in OWN_GROUPS.read_text().splitlines():
        _number, controllers, path = line.split(":", 2)
        if "memory" in controllers.split(","):
            return _writable(TOP / "memory" / path.lstrip("/"), V1)
    delegated = TOP / "cgroup.subtree_control"
    if delegated.exists() and "memory" in delegated.read_text().split():
        return _writable(TOP, V2)
    return None


def _writable(folder: Path, version: Version) -> tuple[Path, Version] | None:
    return (folder, version) if os.access(folder, os.W_OK) else None


class MemoryGroup:
    """All that people start on one host."""

    def __init__(self, folder: Path, version: Version) -> None:
        self.folder, self._version = folder, version

    @classmethod
    def of_host(cls, host: str, limit_mib: int) -> Self | None:
        """Make it; None where this machine lets none be made."""
        below = parent()
        if below is None:
            return None
        folder, version = below
        name = f"{PREFIX}.{namespaces.keeper()}.{host}"
        group = cls(folder / name, version)
        group.folder.mkdir()
        limit = limit_mib * MIB
        (group.folder / version.limit).write_text(str(limit))
        swap = group.folder / version.swap
        if swap.exists():  # who takes too much would else go on, slowly, by swapping
            swap.write_text(str(limit if version.counts_both else 0))
        return group

    def admit(self, pid: int) -> None:
        """Take a process in; what it starts is born there."""
        try:
            (self.folder / "cgroup.procs").write_text(str(pid))
        except ProcessLookupError:
            return  # it has ended

    @property
    def killed(self) -> int:
        """How many processes were killed as all together took too much."""
        lines = (self.folder / self._version.events).read_text().splitlines()
        return sum(int(line.removeprefix(KILLED)) for line in lines if line.startswith(KILLED))

    def remove(self) -> None:
        """Take it away when all in it have ended; raise NetworkError if they do not."""
        deadline = time.monotonic() + END_TIMEOUT_S
        while self.folder.exists():
            try:
                self.folder.rmdir()
            except OSError as error:  # busy
                if time.monotonic() > deadline:
                    raise NetworkError(f"{self.folder}: {error.strerror}") from error
                time.sleep(POLL_S)


def groups_of_gone() -> Iterator[Path]:
    below = parent()
    for folder in below[0].glob(f"{PREFIX}.*") if below else ():
        _prefix, *keeper, _host = folder.name.split(".", 3)
        if namespaces.keeper_is_gone(".".join(keeper)):
            yield folder
