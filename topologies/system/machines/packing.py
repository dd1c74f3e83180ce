"""The packing of folders that go to another machine, or come from there: files and folders alone.

A folder is checked as a whole (wire/packed_folder.py) before its first file is written.
"""

import os
import stat
from collections.abc import Collection, Iterator
from pathlib import Path

from topologies.system.processes.programs import NetworkError
from wire.malformed import MalformedPacket
from wire.packed_folder import MOST_BYTES, Entry, Kind, decode, encode

BYTE_CODE = "__pycache__"
PRIVATE, PRIVATE_PROGRAM = 0o600, 0o700  # modes
READ = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK
NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW


def pack(folder: Path, without: Collection[Path] = (), *, pass_over: bool = False) -> bytes:
    """Return a folder as bytes, without byte code of Python, and without some folders in it.

    With `pass_over` leave out entries that are neither a file nor a folder, as links. Raise
    NetworkError for them otherwise, and for a folder that is too large.
    """
    entries, left = list[Entry](), MOST_BYTES
    try:
        for entry in _entries(folder.resolve(), {each.resolve() for each in without}, pass_over):
            left -= len(entry.data)
            if left < 0:
                raise NetworkError(
                    f"{folder} has more than {MOST_BYTES >> 20} MiB, which do not go to another "
                    "machine: take a folder with less in it"
                )
            entries.append(entry)
        return encode(entries)
    except OSError as error:
        raise NetworkError(f"cannot read {error.filename}: {error.strerror}") from error
    except ValueError as error:
        raise NetworkError(f"{folder} cannot go to another machine: {error}") from error


def _entries(folder: Path, without: Collection[Path], pass_over: bool) -> Iterator[Entry]:
    """Yield what is in a folder, each folder before what is in it; follow no link."""
    for path, folders, files, descriptor in os.fwalk(folder, onerror=_give_up):
        place = Path(path)
        folders[:] = [each for each in sorted(folders) if _goes(place / each, without)]
        for name in (*folders, *sorted(files)):
            within = str((place / name).relative_to(folder))
            if (entry := _entry(within, name, descriptor)) is not None:
                yield entry
            elif not pass_over:
                raise NetworkError(
                    f"{place / name} is neither a file nor a folder, and does not go to another "
                    "machine: put a copy of what it leads to in its place"
                )


def _give_up(error: OSError) -> None:
    raise error


def _goes(folder: Path, without: Collection[Path]) -> bool:
    return folder.name != BYTE_CODE and folder not in without


def _entry(within: str, name: str, folder: int) -> Entry | None:
    """Return what has a name in an open folder; None if it is neither a file nor a folder."""
    mode = os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode
    if stat.S_ISDIR(mode):
        return Entry(within, Kind.FOLDER)
    if not stat.S_ISREG(mode):
        return None
    with open(os.open(name, READ, dir_fd=folder), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            return None  # it has become something else meanwhile
        kind = Kind.PROGRAM if status.st_mode & stat.S_IXUSR else Kind.FILE
        return Entry(within, kind, max(0, status.st_mtime_ns), file.read(MOST_BYTES + 1))


def unpack(packed: bytes, folder: Path) -> None:
    """Write what was packed into a folder, which has none of it; only its owner can read it.

    Raise NetworkError, before anything is written, for what is not a packed folder.
    """
    write(unpacked(packed), folder)


def unpacked(packed: bytes) -> list[Entry]:
    """Return what is in a packed folder; raise NetworkError if it is none."""
    try:
        return decode(packed)
    except MalformedPacket as error:
        raise NetworkError(f"from another machine came {error}") from error


def write(entries: Collection[Entry], folder: Path) -> None:
    """Write files and folders that were checked; raise NetworkError if one exists or cannot be.

    All are private, and were changed when they say that they were.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for entry in entries:
            _write(entry, folder / entry.name)
    except OSError as error:
        raise NetworkError(f"cannot write {error.filename}: {error.strerror}") from error


def _write(entry: Entry, path: Path) -> None:
    if entry.kind is Kind.FOLDER:
        path.mkdir(mode=0o700)
        return
    mode = PRIVATE_PROGRAM if entry.kind is Kind.PROGRAM else PRIVATE
    with open(os.open(path, NEW, mode), "wb") as file:
        file.write(entry.data)
    os.utime(path, ns=(entry.changed_ns, entry.changed_ns))
