"""The file of the controller's record (wire/controller_record.py)."""

import os
from typing import Any

from wire.controller_record import fact_line


class Record:
    """Appends to a file; each line is one write, so that lines of two threads stay whole."""

    def __init__(self, path: str) -> None:
        """Open the file; an empty path records nothing."""
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
        self._file = os.open(path, flags, 0o644) if path else None

    def write(self, event: str, **fields: Any) -> None:
        """Append one fact."""
        if self._file is not None:
            os.write(self._file, fact_line(event, **fields))
