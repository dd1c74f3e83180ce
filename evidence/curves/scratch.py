"""The folder of a sweep's temporary files; what a killed sweep has left goes with the next one."""

import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import geteuid
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from topologies.system.processes.owners import gone, namespace, this_process


@contextmanager
def scratch_folder() -> Iterator[str]:
    remove_left()
    with TemporaryDirectory(prefix=f"{prefix()}{this_process()}-") as folder:
        yield folder


def remove_left() -> None:
    """Remove those of this user's sweeps that have ended without doing it."""
    for folder in Path(gettempdir()).glob(f"{prefix()}*"):
        owner = folder.name.removeprefix(prefix()).rpartition("-")[0]
        with suppress(FileNotFoundError):  # another sweep removes it, too
            status = folder.lstat()
            if gone(owner) and stat.S_ISDIR(status.st_mode) and status.st_uid == geteuid():
                shutil.rmtree(folder)


def prefix() -> str:
    return f"qmn-sweep-{namespace()}-"
