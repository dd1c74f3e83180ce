"""The pages of networks, in a folder: of one command, or of this machine (`qmn live --all`).

Each has a number there, and what serves it.

Networks begin in other processes, perhaps in namespaces of their own, which share files alone: each
finds the folder by its environment, and serves its page at a socket there as long as it runs.
"""

import fcntl
import os
import secrets
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from topologies.system.runs.runtime import LIVE_PAGES, MACHINE_PAGES

SECRET, PORT, NAME, SOCKET, LOCK = "secret", "port", "name", "socket", "lock"
NUMBER = "QMN_LIVE_NUMBER"  # in the environment of what serves a network
ENDED = "ended"  # what the socket is then called


@dataclass(frozen=True)
class Pages:
    """The folder, which its owner alone can look into."""

    folder: Path

    @staticmethod
    def of_command() -> "Pages | None":
        """Return those of the command that this process is part of; None if it has none."""
        folder = os.environ.get(LIVE_PAGES)
        return Pages(Path(folder)) if folder else None

    @staticmethod
    def of_machine() -> "Pages | None":
        """Return those of all networks of this machine; None if nobody shows them."""
        try:
            with (MACHINE_PAGES / LOCK).open() as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return Pages(MACHINE_PAGES)
        except FileNotFoundError:
            pass
        return None  # or who has shown them was killed

    @property
    def secret(self) -> str:
        """The end of the address; it is made when it is first asked for."""
        file = self.folder / SECRET
        if not file.exists():
            file.touch(mode=0o600)
            file.write_text(secrets.token_urlsafe(16))
        return file.read_text()

    @property
    def port(self) -> int:
        return int((self.folder / PORT).read_text())

    @contextmanager
    def one_more(self, name: str) -> Iterator[int]:
        """Number a network that begins; yield that, by which its server finds the rest here."""
        number = self._next()
        folder = self.folder / str(number)
        (folder / NAME).write_text(name)
        try:
            yield number
        finally:
            if (folder / SOCKET).exists():
                (folder / SOCKET).rename(folder / ENDED)

    def _next(self) -> int:
        """Take the least number that no network has; two take none at a time."""
        number = 0
        while True:
            number += 1
            with suppress(FileExistsError):
                (self.folder / str(number)).mkdir()
                return number

    def names(self) -> dict[int, str]:
        """Return the names of the networks whose page is, or was, served; the oldest first."""
        files = [*self.folder.glob(f"*/{SOCKET}"), *self.folder.glob(f"*/{ENDED}")]
        names = {int(file.parent.name): (file.parent / NAME).read_text() for file in files}
        return dict(sorted(names.items()))

    def socket(self, number: int) -> str:
        return str(self.folder / str(number) / SOCKET)

    def runs(self, number: int) -> bool:
        with socket.socket(socket.AF_UNIX) as asking:
            try:
                asking.connect(self.socket(number))
            except OSError:  # it is not there any more, or who has served it was killed
                return False
        return True


@contextmanager
def kept_of_machine() -> Iterator[Pages]:
    """Keep a folder for pages of the networks that start on this machine.

    The server of its address removes it. Raise OSError if another shows them.
    """
    if Pages.of_machine():
        raise OSError("another `qmn live --all` shows the networks of this machine")
    shutil.rmtree(MACHINE_PAGES, ignore_errors=True)  # of one that was killed
    MACHINE_PAGES.mkdir(mode=0o700, parents=True)
    with (MACHINE_PAGES / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # a network that starts has it for a moment
        yield Pages(MACHINE_PAGES)
