"""A JSON line for each fact, for measurements."""

import json
import os
import time
from typing import Any


class Record:
    """Appends to a file; each line is one write, so that lines of two threads stay whole."""

    def __init__(self, path: str) -> None:
        """Open the file; an empty path records nothing."""
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
        self._file = os.open(path, flags, 0o644) if path else None

    def write(self, event: str, **fields: Any) -> None:
        """Append one fact, stamped with the clock of the captures."""
        if self._file is not None:
            line = json.dumps({"time_ns": time.time_ns(), "event": event, **fields})
            os.write(self._file, line.encode() + b"\n")
