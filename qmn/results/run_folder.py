"""The folder a run leaves behind: runs/<time>-<topology>/, and runs/latest that points to it."""

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from qmn.options import BadInput
from topologies.networks.disk import GONE
from topologies.system.processes.programs import NetworkError

PRIVATE = 0o700  # mode
NOT_WRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS)
REPORT = "report.html"  # of `qmn run`, made again by `qmn report`
STAMP = "%Y%m%dT%H%M%S"  # when a run began, at the start of its name


def make_folder(runs: Path, topology: str) -> Path:
    """Make the folder of a new run, which nobody else can read: captures show what qubits were."""
    missing = [folder for folder in (runs, *runs.parents) if not folder.exists()]
    runs.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        give(folder)
    stamp = time.strftime(STAMP)
    for attempt in range(100):
        suffix = f"-{attempt}" if attempt else ""
        folder = runs.resolve() / f"{stamp}-{topology}{suffix}"
        try:
            folder.mkdir(mode=PRIVATE, parents=True)
        except FileExistsError:
            continue
        return folder
    raise FileExistsError(f"a hundred runs in {runs} carry the stamp {stamp}")


def begin_folder(runs: Path, name: str) -> Path:
    """Return the new folder of a run; raise BadInput if it cannot be made."""
    with writable("--runs", runs):
        folder = make_folder(runs, name)
        point_latest(folder)
    return folder


@contextmanager
def writable(option: str, folder: Path) -> Iterator[None]:
    """Raise BadInput, in the place of an OSError, if the folder of an option cannot be written."""
    try:
        yield
    except OSError as error:
        place = error.filename2 or error.filename
        reason = f"{place}: {error.strerror}" if place else str(error)
        raise BadInput(f"cannot write to {option} {folder}: {reason}") from error


def point_latest(folder: Path) -> None:
    """Let runs/latest point to this run; if it cannot, remove the folder and raise OSError."""
    link = folder.with_name(f".latest-{folder.name}")
    try:
        link.symlink_to(folder.name)
        link.replace(folder.with_name("latest"))
    except OSError:
        link.unlink(missing_ok=True)
        folder.rmdir()
        raise


@contextmanager
def lasting(folder: Path, further: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Raise NetworkError if the folder of a run does not last, or cannot be written any more.

    That is the cause of a NetworkError, an OSError or a further fault that follows.
    """
    faults: tuple[type[Exception], ...] = (NetworkError, OSError, *further)
    try:
        yield
        if not folder.is_dir():
            raise NetworkError(GONE)
    except faults as error:
        if not folder.is_dir():
            text = f"{folder}: {GONE}"
        elif isinstance(error, OSError) and error.errno in NOT_WRITABLE:
            text = f"cannot write to the folder of the run, {folder}: {error.strerror}"
        else:
            raise
        cause = NetworkError(text)
        for note in getattr(error, "__notes__", ()):
            if str(folder) not in note:  # which the cause explains
                cause.add_note(note)
        raise cause from error


def give_to_invoker(folder: Path) -> None:
    for path in (folder.with_name("latest"), folder, *folder.rglob("*")):
        with suppress(FileNotFoundError):  # the user has removed it
            give(path)


def give_tree(folder: Path) -> None:
    for path in (folder, *folder.rglob("*")) if folder.exists() else ():
        give(path)


@contextmanager
def given_at_the_end(folder: str) -> Iterator[None]:
    try:
        yield
    finally:
        if folder:
            give_tree(Path(folder))


def give(path: Path) -> None:
    if os.geteuid() == 0 and "SUDO_UID" in os.environ:
        user, group = int(os.environ["SUDO_UID"]), int(os.environ.get("SUDO_GID", "-1"))
        os.chown(path, user, group, follow_symlinks=False)
