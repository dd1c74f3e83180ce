"""The bounds of what a run writes: logs that somebody floods, the disk that it must not fill."""

import shutil
import sys
import time
from pathlib import Path

import pytest

from topologies.networks import disk
from topologies.networks.disk import DiskKeeper, nearly_full
from topologies.system.processes.programs import NetworkError, Program

FLOOD = """
import pathlib, sys, time
folder = pathlib.Path(sys.argv[1])
for number in range(20_000):
    print("a bad message", number, flush=True)
(folder / "flooded").touch()
while not (folder / "go").exists():
    time.sleep(0.01)
print("the end", flush=True)
"""


def test_a_log_that_is_flooded_keeps_its_newest_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line that is written while a log is cut may be lost: the last one is written later."""
    monkeypatch.setattr(disk, "LOG_BYTES", 50_000)
    logs, signs = tmp_path / "logs", tmp_path / "signs"
    logs.mkdir()
    signs.mkdir()
    flooded = Program("alice", logs / "alice.log")
    keeper = DiskKeeper([logs], lambda: [flooded])
    flooded.start([sys.executable, "-c", FLOOD, str(signs)])
    while flooded.running and not (signs / "flooded").exists():
        keeper.look()
    keeper.look()  # it may have written all before the first
    (signs / "go").touch()
    while flooded.running:
        time.sleep(0.01)
    keeper.look()
    kept = (logs / "alice.log.1").read_text() + flooded.output()
    assert kept.rstrip().endswith("the end")
    sizes = {path.name: path.stat().st_size for path in logs.iterdir()}
    assert sizes.keys() == {"alice.log", "alice.log.1"}
    assert sizes["alice.log"] <= 50_000
    assert sum(sizes.values()) < 20_000 * len("a bad message 10000")


def test_a_disk_that_is_nearly_full_ends_the_run_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert nearly_full(tmp_path) == ""
    keeper = DiskKeeper([tmp_path], list)
    keeper.look()
    keeper.check()
    full = type(shutil.disk_usage(tmp_path))(total=200 << 30, used=199 << 30, free=900_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: full)
    keeper.look()
    with pytest.raises(NetworkError, match=r"is nearly full: 900 MB are free; .*--captures none"):
        keeper.check()


def test_a_folder_that_is_removed_or_renamed_ends_the_run_by_name(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    for remove in (Path.rmdir, lambda path: path.rename(tmp_path / "elsewhere")):
        folder.mkdir()
        keeper = DiskKeeper([folder], list)
        keeper.look()
        keeper.check()
        remove(folder)
        keeper.look()
        with pytest.raises(NetworkError, match=f"^{folder}: .* was removed or renamed"):
            keeper.check()
