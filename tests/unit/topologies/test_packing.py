"""The packing of folders, and what is written of those that come from elsewhere."""

import os
import socket
import struct
from pathlib import Path
from typing import Any

import pytest

from topologies.system.machines import packing
from topologies.system.machines.packing import pack, unpack
from topologies.system.processes.programs import NetworkError

CHANGED_NS = 1_234_567_890_123_456_789


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with files, of which one can be executed, and byte code."""
    made = tmp_path / "app"
    for name, data in (
        ("data/deep/word.txt", b"word"),
        ("app_bob.py", b"pass"),
        ("__pycache__/app_bob.pyc", b"\0"),
        ("runs/now/all.pcapng", b"large"),
    ):
        file = made / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)
    (made / "empty").mkdir()
    (made / "tool").write_bytes(b"#!/bin/sh\n")
    (made / "tool").chmod(0o755)
    os.utime(made / "app_bob.py", ns=(0, CHANGED_NS))
    return made


def found(folder: Path) -> dict[str, bytes | None]:
    """Return what is in a folder by its name; None of folders."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def test_what_was_packed_is_there_again_and_its_owners_alone(folder: Path, tmp_path: Path) -> None:
    there = tmp_path / "there"
    unpack(pack(folder, without=[folder / "runs"]), there)
    assert found(there) == {
        "app_bob.py": b"pass",
        "data": None,
        "data/deep": None,
        "data/deep/word.txt": b"word",
        "empty": None,
        "tool": b"#!/bin/sh\n",
    }
    modes = {path.name: path.stat().st_mode & 0o7777 for path in [there, *there.rglob("*")]}
    private = dict.fromkeys(("there", "data", "deep", "empty", "tool"), 0o700)
    assert modes == {**private, "app_bob.py": 0o600, "word.txt": 0o600}
    assert (there / "app_bob.py").stat().st_mtime_ns == CHANGED_NS


def test_a_folder_that_a_link_leads_to_is_packed_as_itself(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(folder)
    assert pack(tmp_path / "link") == pack(folder)


@pytest.mark.parametrize("kind", ["file", "folder", "nowhere", "pipe", "socket"])
def test_links_and_devices_are_refused_by_name_or_passed_over(
    kind: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = pack(folder)
    secret = tmp_path / "secret"
    secret.mkdir()
    (secret / "key").write_bytes(b"secret key")
    odd = folder / "data" / "odd"
    if kind == "pipe":
        os.mkfifo(odd)
    elif kind == "socket":
        monkeypatch.chdir(odd.parent)  # the path of a socket must be short
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(odd.name)
    else:
        odd.symlink_to({"file": secret / "key", "folder": secret}.get(kind, tmp_path / "none"))
    with pytest.raises(NetworkError, match=rf"{odd} is neither a file nor a folder"):
        pack(folder)
    assert pack(folder, pass_over=True) == before


def test_a_file_that_becomes_a_link_meanwhile_is_not_followed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "key").write_bytes(b"secret key")
    file = folder / "data" / "deep" / "word.txt"
    look = os.stat

    def swap(path: str, **options: Any) -> os.stat_result:
        status = look(path, **options)
        if path == file.name and not file.is_symlink():
            file.unlink()
            file.symlink_to(tmp_path / "key")
        return status

    monkeypatch.setattr(os, "stat", swap)
    with pytest.raises(NetworkError, match=r"cannot read word\.txt"):
        pack(folder, pass_over=True)


def test_what_is_too_large_or_cannot_be_named_is_refused_by_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    odd = os.path.join(os.fsencode(folder), b"\xff")
    Path(os.fsdecode(odd)).touch()
    with pytest.raises(NetworkError, match=f"{folder} cannot go to another machine"):
        pack(folder)
    os.unlink(odd)
    monkeypatch.setattr(packing, "MOST_BYTES", 8)
    with pytest.raises(NetworkError, match=f"{folder} has more than"):
        pack(folder)


def test_a_folder_that_is_not_there_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match=r"cannot read .*none: No such file"):
        pack(tmp_path / "none")


@pytest.mark.parametrize("name", [b"../escaped", b"/tmp/escaped", b"a/../../escaped"])
def test_nothing_is_written_of_a_folder_that_would_reach_out_of_its_place(
    name: bytes, tmp_path: Path
) -> None:
    entries = [(b"good", 1, b"1"), (name, 1, b"2")]
    hostile = b"".join(
        struct.pack("!BHQI", kind, len(name), 0, len(data)) + name + data
        for name, kind, data in entries
    )
    with pytest.raises(
        NetworkError, match=r"from another machine came .* not a name inside a folder"
    ):
        unpack(hostile, tmp_path / "there")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("taken", ["app_bob.py", "data"])
def test_what_is_there_is_not_written_over_nor_through(
    taken: str, folder: Path, tmp_path: Path
) -> None:
    there, elsewhere = tmp_path / "there", tmp_path / "elsewhere"
    there.mkdir()
    elsewhere.mkdir()
    (there / taken).symlink_to(elsewhere)
    with pytest.raises(NetworkError, match=f"cannot write .*{taken}: File exists"):
        unpack(pack(folder), there)
    assert list(elsewhere.iterdir()) == []
