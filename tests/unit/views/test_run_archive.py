"""A run that travels as one file, and what is refused on the way."""

import json
import re
import shutil
import zipfile
import zlib
from pathlib import Path
from random import Random
from typing import Any

import pytest
from runs_scene import OLD, called
from runs_scene import runs as runs

from views.archive.archive import BadArchive, imported
from views.archive.index import runs_in


def test_a_run_travels_as_one_file(runs: Path, tmp_path: Path) -> None:
    file, result = tmp_path / "run.zip", runs / OLD / "result.json"
    content = json.loads(result.read_text())
    result.write_text(json.dumps({name: content[name] for name in content if name != "service"}))
    assert called(runs, "export", OLD, str(file)) == 0
    assert called(tmp_path / "other", "import", str(file)) == 0
    copy = tmp_path / "other" / OLD
    assert (copy / "result.json").read_bytes() == (runs / OLD / "result.json").read_bytes()
    # Its result does not name its service: it may have made keys.
    assert not (copy / "quantum.pcapng").exists()
    assert [run.name for run in runs_in(tmp_path / "other")] == [OLD]
    for words in (("export", OLD, str(file)), ("import", str(file))):
        assert called(tmp_path / "other", *words) == 1  # neither is written over


def test_a_whole_run_is_for_its_owner_alone(runs: Path, tmp_path: Path) -> None:
    file = tmp_path / "run.zip"
    assert called(runs, "export", OLD, str(file), "--whole") == 0
    assert file.stat().st_mode & 0o777 == 0o600
    copy = imported(file, tmp_path / "other")
    names = {path.name for path in (runs / OLD).iterdir()}
    assert {path.name for path in copy.iterdir()} == names
    assert copy.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    "names",
    [
        ["../result.json"],
        ["a/result.json", "b/result.json"],
        ["/a/result.json"],
        ["a/../result.json"],
        ["a/b/result.json"],
        ["a/result.json", "a/.hidden"],
        ["a/other"],
        [],
    ],
)
def test_a_file_that_is_no_run_is_refused_and_leaves_nothing(
    tmp_path: Path, names: list[str]
) -> None:
    file = tmp_path / "hostile.zip"
    with zipfile.ZipFile(file, "w") as archive:
        for name in names:
            archive.writestr(name, "{}")
    with pytest.raises(BadArchive, match="is not a run"):
        imported(file, tmp_path / "runs")
    assert [path.name for path in tmp_path.iterdir()] == ["hostile.zip"]


@pytest.mark.parametrize("name", ["latest", "notes", "20261399T100000-x", "index.sqlite"])
def test_a_folder_that_is_called_as_no_run_is_refused(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    file = tmp_path / "named.zip"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(f"{name}/result.json", "{}")
    before = sorted(runs.rglob("*"))
    assert called(runs, "import", str(file)) == 1
    assert f"{name} is not the name of a run, such as 2026" in capsys.readouterr().err
    assert sorted(runs.rglob("*")) == before


def test_scripts_and_pages_of_a_file_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "code.zip"
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("result.json", "qmn.lua", "dispatcher.proto", "report.html"):
            archive.writestr(f"{OLD}/{name}", "{}")
    folder = imported(file, tmp_path / "runs")
    assert [path.name for path in folder.iterdir()] == ["result.json"]


def test_the_reserve_of_the_disk_stays_free_of_an_import(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two MB of zeros are in an archive of a few kB; the reserve is one GiB."""
    file = tmp_path / "bomb.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{OLD}/result.json", "{}")
        archive.writestr(f"{OLD}/zeros", bytes(2_000_000))
    assert file.stat().st_size < 10_000
    usage = type(shutil.disk_usage(tmp_path))
    for free, fits in (((1 << 30) + 1_999_999, False), ((1 << 30) + 2_000_002, True)):
        left = usage(total=200 << 30, used=0, free=free)
        monkeypatch.setattr(shutil, "disk_usage", lambda _folder, left=left: left)
        folder = tmp_path / f"of {free}"
        if fits:
            assert (imported(file, folder) / "zeros").stat().st_size == 2_000_000
        else:
            with pytest.raises(BadArchive, match=r"holds 2 MB, .* nearly full: make room"):
                imported(file, folder)
            assert list(folder.iterdir()) == []


def test_an_archive_that_unpacks_to_over_a_hundred_times_its_size_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Deflate writes zeros in a thousandth of their size (RFC 1951: 258 bytes in 2 bits)."""
    monkeypatch.setattr("views.archive.archive.FREE_BYTES", 1 << 20)
    file = tmp_path / "bomb.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{OLD}/result.json", "{}")
        archive.writestr(f"{OLD}/zeros", bytes(5 << 20))
    folder = tmp_path / "runs"
    with pytest.raises(BadArchive, match="holds 5 MB, over 100 times its own size"):
        imported(file, folder)
    assert not folder.exists() or list(folder.iterdir()) == []


@pytest.mark.nightly  # by day: a spoiled result, and archives that lack something
def test_a_spoiled_archive_is_refused_in_one_line(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One byte of it is another, or the end is missing."""
    whole, file = tmp_path / "whole.zip", tmp_path / "spoiled.zip"
    assert called(runs, "export", OLD, str(whole)) == 0
    capsys.readouterr()
    random, good, refused = Random(1), whole.read_bytes(), 0
    for number in range(400):
        data = bytearray(good)
        if number % 4:
            at = random.randrange(len(data)) if number % 2 else -random.randrange(1, 400)
            data[at] = random.randrange(256)
        else:
            del data[random.randrange(len(data)) :]
        file.write_bytes(data)
        if called(tmp_path / "other", "import", str(file)) == 0:
            shutil.rmtree(tmp_path / "other" / OLD)
        else:
            refused += 1
            assert re.fullmatch(r"qmn: .*\n", capsys.readouterr().err)
            assert list((tmp_path / "other").glob("*")) == []
    assert refused > 200


@pytest.mark.parametrize("end", [KeyboardInterrupt, zlib.error, OSError])
def test_an_import_that_ends_in_its_middle_leaves_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: type[BaseException]
) -> None:
    file, copy = tmp_path / "run.zip", shutil.copyfileobj
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("result.json", "second", "third"):
            archive.writestr(f"{OLD}/{name}", "{}")

    def break_off(packed: Any, written: Any) -> None:
        copy(packed, written)
        if Path(written.name).name == "second":
            raise end

    monkeypatch.setattr(shutil, "copyfileobj", break_off)
    with pytest.raises((KeyboardInterrupt, BadArchive)):
        imported(file, tmp_path / "runs")
    assert list((tmp_path / "runs").iterdir()) == []
    monkeypatch.undo()
    assert len(list(imported(file, tmp_path / "runs").iterdir())) == 3


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"no zip"])
def test_what_is_no_zip_is_refused(tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "broken.zip"
    file.write_bytes(data)
    with pytest.raises(BadArchive):
        imported(file, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()
