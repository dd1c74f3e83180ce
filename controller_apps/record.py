"""The file of the controller's record (wire/controller_lines.py)."""

import os
import threading
from typing import Any

from wire.controller_lines import EARLIER, fact_line
from wire.network_time import REAL_TIME, NetworkTime

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
