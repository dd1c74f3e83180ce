"""The files of a key store: each appears whole and is removed by one process alone."""

import ctypes
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

_UNFINISHED = ".new"


class KeyStoreError(Exception):
    """The store cannot do what it was asked to do."""


class MissingKey(KeyStoreError):
    """There is no such key: it never was here, or it was handed out already."""


class DuplicateKey(KeyStoreError):
    """A key of this id is in the store."""


def names(folder: Path) -> list[str]:
    return [name for name in os.listdir(folder) if not name.endswith(_UNFINISHED)]


def clean(folder: Path) -> None:
    for name in os.listdir(folder):
        if not name.endswith(_UNFINISHED):
            continue
        path = folder / name
        if not Path("/proc", path.suffixes[-2].removeprefix(".")).exists():
            path.unlink(missing_ok=True)


def age(path: Path) -> int:
    """Return when (ns) a key was written; 0 if it is gone."""
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return 0


def write(path: Path, key: bytes) -> None:
    """Create a file with its whole content, or raise DuplicateKey; both are on disk then."""
    unfinished = f"{path}{_suffix()}"
    descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        os.write(descriptor, key)
        os.fsync(descriptor)
        os.link(unfinished, path)
    except FileExistsError as error:
        raise DuplicateKey(f"key {path.name} is in the store already") from error
    finally:
        os.close(descriptor)
        os.unlink(unfinished)
    sync_folder(path.parent)


def create_all(folder: Path, keys: Mapping[str, bytes]) -> None:
    """Create files by their names, with their whole content, or none; they are on disk then.

    They go to the disk together: one after the other, a thousand take seconds.
    """
    suffix, named = _suffix(), 0
    inside = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for name, key in keys.items():
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            descriptor = os.open(name + suffix, flags, 0o600, dir_fd=inside)
            try:
                os.write(descriptor, key)
            finally:
                os.close(descriptor)
        _sync_file_system(inside)
        for name in keys:
            os.rename(name + suffix, name, src_dir_fd=inside, dst_dir_fd=inside)
            named += 1
        os.fsync(inside)
    except OSError:
        for number, name in enumerate(keys):
            with suppress(FileNotFoundError):
                os.unlink(name if number < named else name + suffix, dir_fd=inside)
        raise
    finally:
        os.close(inside)


def _suffix() -> str:
    """Return what the names of files end with that this process has not finished."""
    return f".{os.getpid()}{_UNFINISHED}"


def _sync_file_system(descriptor: int) -> None:
    """Wait until all that was written to a file system is on disk, by a descriptor of its own."""
    syncfs = ctypes.CDLL(None, use_errno=True).syncfs
    if syncfs(descriptor) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def remove(folder: Path, name: str) -> bytes:
    """Return the content of a file that this call has removed; MissingKey if another did."""
    key = unlink(folder, name)
    sync_folder(folder)
    return key


def unlink(folder: Path, name: str) -> bytes:
    """Do the same; that it is removed is not on disk yet."""
    path = folder / name
    try:
        with path.open("rb") as file:
            path.unlink()
            return file.read()
    except FileNotFoundError as error:
        raise MissingKey(f"key {name} is not in the store, or was handed out already") from error


def sync_folder(folder: Path) -> None:
    """Wait until what was made and removed in a folder is on disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
