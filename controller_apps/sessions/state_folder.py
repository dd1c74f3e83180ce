"""The private folder in which a controller keeps what the next one shall know; see snapshot.py.

One file a session, one for the hosts. A file is replaced whole, so that a controller may be
killed at any moment, and deleted with its session, so that the folder does not grow.
"""

import errno
import os
from collections.abc import Iterator
from pathlib import Path

from controller_apps.sessions.sessions import MAX_SESSIONS

HOSTS = "hosts"
MAX_SIZE = 1 << 22  # bytes of a file


class StateFolder:
    """Reads and writes the files; with an empty path there are none."""

    def __init__(self, path: str) -> None:
        """Make the folder or take it over; raise OSError if that cannot be, or is not safe."""
        self._folder = Path(path) if path else None
        if self._folder is None:
            return
        self._folder.mkdir(mode=0o700, exist_ok=True)
        status = self._folder.stat()
        if status.st_uid != os.geteuid() or status.st_mode & 0o077:
            raise PermissionError(0, "it must be its owner's alone (chmod 700)", path)

    @property
    def restored(self) -> bool:
        """Whether another controller has been here before."""
        return self._folder is not None and (self._folder / HOSTS).exists()

    def keep_session(self, number: int, data: bytes) -> None:
        self._replace(f"{number:016x}", data)

    def forget_session(self, number: int) -> None:
        if self._folder is not None:
            (self._folder / f"{number:016x}").unlink(missing_ok=True)

    def sessions(self) -> Iterator[tuple[int, bytes]]:
        """Yield number and data of each session, at most as many as there can be."""
        if self._folder is None:
            return
        names = sorted(path.name for path in self._folder.iterdir() if is_number(path.name))
        for name in names[:MAX_SESSIONS]:
            yield int(name, 16), self._read(self._folder / name)

    def keep_hosts(self, data: bytes) -> None:
        self._replace(HOSTS, data)

    def hosts(self) -> bytes:
        return self._read(self._folder / HOSTS) if self._folder and self.restored else b""

    def _read(self, file: Path) -> bytes:
        with file.open("rb") as stream:
            return stream.read(MAX_SIZE)

    def _replace(self, name: str, data: bytes) -> None:
        if self._folder is None:
            return
        # By plain system calls: a set-up message waits for it.
        new = f"{self._folder}/{name}.new"
        file = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        try:
            written = os.write(file, data)
        finally:
            os.close(file)
        if written < len(data):
            raise OSError(errno.ENOSPC, "written in part only", new)
        os.replace(new, f"{self._folder}/{name}")


def is_number(name: str) -> bool:
    return len(name) == 16 and not set(name) - set("0123456789abcdef")
