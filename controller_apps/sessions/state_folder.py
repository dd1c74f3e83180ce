"""The private folder in which a controller keeps what the next one shall know; see snapshot.py.

One file a session, one for the hosts. A file is replaced whole, so that a controller may be
killed at any moment, and deleted with its session, so that the folder does not grow.
"""

import errno
import os
from collections.abc import Iterator
from logging import Logger
from pathlib import Path

from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.sessions import MAX_SESSIONS
from controller_apps.sessions.snapshot import decode_hosts, decode_session
from wire.malformed import MalformedPacket

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


def take_over(state: StateFolder, arbiter: Arbiter, logger: Logger, now: float) -> list[int]:
    """Give the arbiter the hosts and sessions that were kept; return the sessions.

    A session that is malformed, or excluded by another one, is logged and dropped.
    """
    if state.restored:
        arbiter.recovery.begun = now
    try:
        for at, host_port in decode_hosts(state.hosts()).items():
            arbiter.network.attach(at, host_port)
    except MalformedPacket as error:
        logger.warning("hosts that were kept: %s", error)
    return [
        number
        for number, data in list(state.sessions())
        if _resume(number, data, state, arbiter, logger, now)
    ]


def _resume(
    number: int, data: bytes, state: StateFolder, arbiter: Arbiter, logger: Logger, now: float
) -> bool:
    try:
        session = decode_session(data, now)
        if session.number != number:
            raise MalformedPacket(f"it is session {session.number:016x}")
        arbiter.resume(session, now)
    except MalformedPacket as error:
        logger.warning("session %016x that was kept: %s", number, error)
        state.forget_session(number)
        return False
    return True
