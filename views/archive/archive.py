"""A run as one file: a zip of its files but for what is secret, and what is read back of one."""

import lzma
import re
import shutil
import struct
import zipfile
import zlib
from pathlib import Path
from tempfile import TemporaryDirectory

from qmn.results.run_folder import PRIVATE, REPORT, give, give_tree
from topologies.networks.disk import has_room
from views.archive.named_run import is_name
from views.archive.shared_copy import FILE_MODE, CannotShare, share
from views.dissection.dissectors import PROTOCOL, SCRIPT
from wire.results.run_result import RESULT

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,99}")
OWN_MODE = 0o600
MOST_FILES, MOST_BYTES = 10_000, 64 << 30  # of a file that somebody else has made
FREE_BYTES, MOST_RATIO = 256 << 20, 100  # unpacked, and beyond that times the archive's own bytes


MADE = (SCRIPT, PROTOCOL.name, REPORT)  # from the rest, by qmn itself
# Errors of zipfile and its decompressors for a file that is spoiled, cut off or encrypted.
UNREADABLE = (
    *(zipfile.BadZipFile, EOFError, RuntimeError, ValueError, OverflowError),
    *(lzma.LZMAError, struct.error, zlib.error),
)


class BadArchive(Exception):
    """A run that cannot be written as a file, or a file that is not a run; the text says why."""


def exported(run: Path, file: Path, whole: bool = False) -> list[str]:
    """Write a run as a new file; return the names of what was left out as secret.

    Whole: leave nothing out, and let nobody else read the file.
    """
    with TemporaryDirectory(prefix="qmn-export-") as folder:
        copy, left_out = run, list[str]()
        if not whole:
            copy = Path(folder) / run.name
            try:
                left_out = share(run, copy)
            except CannotShare as error:
                raise BadArchive(str(error)) from error
        try:
            file.touch(OWN_MODE if whole else FILE_MODE, exist_ok=False)
        except FileExistsError as error:
            raise BadArchive(f"{file} exists already: choose another name") from error
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(copy.iterdir()):
                if path.is_file() and not path.is_symlink():
                    archive.write(path, f"{run.name}/{path.name}")
    give(file)
    return left_out


def imported(file: Path, runs: Path) -> Path:
    """Make a run of a file that `exported` wrote; return its folder, which did not exist before.

    Scripts and pages are left out: qmn makes them from the rest. Raise BadArchive, and leave
    nothing, for a file that holds anything else, or more than the disk has room for.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            folder = runs.resolve() / _checked(file, members)
            if folder.exists():
                raise BadArchive(f"{folder} exists already: rename it to import another")
            folder.mkdir(mode=PRIVATE, parents=True)
            try:
                _unpack(archive, members, folder)
            except BaseException:
                shutil.rmtree(folder)
                raise
    except UNREADABLE as error:
        raise BadArchive(f"{file} is not a run as `qmn runs export` writes it: {error}") from error
    except OSError as error:
        name = error.filename or file
        raise BadArchive(f"cannot import {name}: {error.strerror or error}") from error
    give_tree(folder)
    return folder


def _unpack(archive: zipfile.ZipFile, members: list[zipfile.ZipInfo], folder: Path) -> None:
    """Write the files of a run; raise BadArchive if the disk has no room for them."""
    size = sum(member.file_size for member in members)
    if not has_room(folder, size):
        raise BadArchive(
            f"{archive.filename} holds {size / 1e6:,.0f} MB, and the disk of {folder.parent} would "
            "be nearly full: make room, as by `qmn runs prune`"
        )
    for member in members:
        name = Path(member.filename).name
        if name not in MADE:
            with archive.open(member) as packed, (folder / name).open("xb") as written:
                shutil.copyfileobj(packed, written)


def _checked(file: Path, members: list[zipfile.ZipInfo]) -> str:
    """Return the name of the run in an archive whose members are files of one plain folder."""
    names = [member.filename.split("/") for member in members]
    plain = all(len(parts) == 2 and all(map(NAME.fullmatch, parts)) for parts in names)
    folders = {parts[0] for parts in names}
    inside = {parts[-1] for parts in names}
    if not plain or len(folders) != 1 or RESULT not in inside or len(inside) != len(names):
        raise BadArchive(f"{file} is not a run as `qmn runs export` writes it")
    (name,) = folders
    if not is_name(name):
        raise BadArchive(f"{file}: {name} is not the name of a run, such as 20261128T150600-sdc")
    size = sum(member.file_size for member in members)
    if len(members) > MOST_FILES or size > MOST_BYTES:
        raise BadArchive(f"{file} holds more than {MOST_FILES} files or {MOST_BYTES >> 30} GiB")
    if size > max(FREE_BYTES, MOST_RATIO * file.stat().st_size):
        raise BadArchive(
            f"{file} holds {size / 1e6:,.0f} MB, over {MOST_RATIO} times its own size, as no run "
            "does: if you trust it, unpack it into the folder of runs yourself"
        )
    return name
