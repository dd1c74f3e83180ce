"""Space on the disk: what a run writes is bounded, also by those who flood it with messages.

A program's log keeps its newest lines, at most LOG_BYTES twice: in the log, and before that in
<log>.1. A capture that has become too long ends. Where the disk of the run's folder is
nearly full, the run ends before it is.
"""

import os
import shutil
import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Self

from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import DISK_LOOK_S

LOG_BYTES = 16 << 20
RESERVE_BYTES = 1 << 30  # that stay free, or a hundredth of a disk that is smaller than 100 GiB
GONE = "the folder of the run was removed or renamed while it ran: nothing more is left there"


class DiskKeeper:
    """Looks at logs and disks once a second, also while a person thinks at the keyboard."""

    def __init__(
        self,
        folders: Sequence[Path],
        programs: Callable[[], Iterable[Program]],
        bound: Callable[[], None] = lambda: None,
    ) -> None:
        """`bound` is called to end other files that have become too long."""
        self._folders = folders
        self._programs = programs
        self._bound = bound
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._full = ""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(DISK_LOOK_S):
            self.look()

    def look(self) -> None:
        """Cut logs that have become long; note if a disk is nearly full, or a folder gone."""
        try:
            for program in list(self._programs()):
                program.cut_log(LOG_BYTES)
            self._bound()
            self.look_at_disks()
        except (FileNotFoundError, NotADirectoryError):
            self.look_at_disks()
            if not self._full:
                raise

    def look_at_disks(self) -> None:
        self._full = next(filter(None, map(nearly_full, self._folders)), "")

    def check(self) -> None:
        """Raise NetworkError if a disk was nearly full at the last look."""
        if self._full:
            raise NetworkError(self._full)


def nearly_full(folder: Path) -> str:
    """Return in words that the disk of a folder is nearly full, or that it is gone, or ""."""
    if not folder.is_dir():
        return f"{folder}: {GONE}"
    files = os.statvfs(folder)
    if files.f_files and not files.f_favail:
        return f"the disk of {folder} has no room for another file (`df -i`): delete some there"
    if has_room(folder):
        return ""
    return (
        f"the disk of {folder} is nearly full: {shutil.disk_usage(folder).free / 1e6:,.0f} MB are "
        "free; make room, or write less (--captures none --without events,record)"
    )


def has_room(folder: Path, further_bytes: int = 0) -> bool:
    usage = shutil.disk_usage(folder)
    return usage.free - further_bytes >= min(RESERVE_BYTES, usage.total // 100)
