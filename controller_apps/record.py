"""The file of the controller's record (wire/controller_lines.py).

The lines that a controller's log has of what hosts send: of each switch port some a second.

A program's log keeps its newest lines (topologies/networks/disk.py): who floods a port would leave
none of the messages of others.
"""

import logging
import os
import threading
from dataclasses import dataclass
from typing import Any

from controller_apps.light.optics import SwitchPort
from wire.controller_lines import EARLIER, fact_line
from wire.network_time import REAL_TIME, NetworkTime

LINES = 5  # of a port, in a second


@dataclass
class Second:
    """A port's share of a second."""

    began_s: float
    lines: int = 0
    left_out: int = 0


class PortLines:
    """Writes a port's share of lines, and how many more there would be."""

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._seconds: dict[SwitchPort, Second] = {}

    def add(self, at: SwitchPort, text: str, now_s: float, level: int = logging.INFO) -> None:
        """Write a line about what came at a port, if that has not had its share."""
        if self._is_over(at, now_s):
            self._begin_anew(at)
        second = self._seconds.setdefault(at, Second(now_s))
        if second.lines < LINES:
            second.lines += 1
            self._logger.log(level, "%s", text)
        else:
            second.left_out += 1

    def time_passed(self, now_s: float) -> None:
        """Say of which ports lines were left out in a second that is over."""
        for at in [at for at in self._seconds if self._is_over(at, now_s)]:
            self._begin_anew(at)

    def _is_over(self, at: SwitchPort, now_s: float) -> bool:
        return at in self._seconds and now_s - self._seconds[at].began_s >= 1

    def _begin_anew(self, at: SwitchPort) -> None:
        if left_out := self._seconds.pop(at).left_out:
            text = "switch %#x port %d: %d more lines, which are left out"
            self._logger.info(text, at.dpid, at.port, left_out)


MOST_BYTES = 32 << 20  # twice: in the file, and before that in the one with the earlier facts


class Record:
    """Appends to a file; each line is one write, so that lines of two threads stay whole.

    A full file becomes that of the earlier facts, and those before them go: hosts that ask
    without end do not fill the disk.
    """

    def __init__(
        self, path: str, time: NetworkTime = REAL_TIME, most_bytes: int = MOST_BYTES
    ) -> None:
        """Open the file; an empty path records nothing."""
        self._path, self._most_bytes, self._time = path, most_bytes, time
        self._lock = threading.Lock()
        self._bytes = 0  # in the file, which nobody else writes
        self._file = self._opened() if path else None

    def _opened(self) -> int:
        opened = os.open(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        self._bytes = os.fstat(opened).st_size
        return opened

    def write(self, event: str, **fields: Any) -> None:
        if self._file is None:
            return
        line = fact_line(self._time.stamp_ns(), event, **fields)
        with self._lock:
            if self._bytes + len(line) > self._most_bytes:
                os.close(self._file)
                os.replace(self._path, self._path + EARLIER)
                self._file = self._opened()
            self._bytes += os.write(self._file, line)
