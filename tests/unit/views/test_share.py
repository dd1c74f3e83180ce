"""qmn runs export: what is in the copy, and what is not."""

import json
import subprocess
import sys
from pathlib import Path

import forked_python
import pytest

from qmn.results.run_folder import make_folder

FILES = (
    "result.json", "report.html", "c0.log", "s1-eth1.pcap", "all.pcapng", "quantum.log",
    "quantum.pcapng", "quantum.qasm", "dispatcher.record", "kme-alice.keys",
)  # fmt: skip


def run_of(folder: Path, service: str) -> Path:
    run = make_folder(folder, "sdc")
    for name in FILES:
        (run / name).write_text(f"content of {name}")
        (run / name).chmod(0o600)
    (run / "elsewhere").symlink_to("/etc/passwd")
    (run / "result.json").write_text(json.dumps({"service": service}))
    return run


def share(run: Path, copy: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "qmn", "runs", "export", str(run), str(copy), *options]
    return forked_python.run(command, 30)


def test_a_run_is_its_owners(tmp_path: Path) -> None:
    assert make_folder(tmp_path, "sdc").stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    ("service", "shared"),
    [("sdc", FILES), ("bb84", FILES[:3]), ("bbm92", FILES[:3]), ("keys", FILES[:3])],
)
def test_a_copy_can_be_read_and_shows_no_key(
    tmp_path: Path, service: str, shared: tuple[str, ...]
) -> None:
    run, copy = run_of(tmp_path, service), tmp_path / "copy"
    done = share(run, copy)
    assert (done.returncode, done.stderr) == (0, "")
    assert {file.name for file in copy.iterdir()} == set(shared)
    for name in shared:
        assert (copy / name).read_bytes() == (run / name).read_bytes()
        assert (copy / name).stat().st_mode & 0o777 == 0o644
    assert copy.stat().st_mode & 0o777 == 0o755
    left_out = {line.removeprefix("left out: ") for line in done.stdout.splitlines()[:-1]}
    assert left_out == {"elsewhere", *FILES} - set(shared)


def test_what_cannot_be_shared_is_named(tmp_path: Path) -> None:
    run = run_of(tmp_path, "sdc")
    there = share(run, tmp_path)
    assert there.returncode == 1
    assert f"cannot make {tmp_path}: File exists; name a folder that does not" in there.stderr
    empty = share(tmp_path, tmp_path / "copy")
    assert empty.returncode == 1
    assert f"{tmp_path}: no result of a run that has ended; `qmn runs`" in empty.stderr
    whole = share(run, tmp_path / "copy", "--whole")
    assert whole.returncode == 1
    assert f"--whole: {tmp_path}/copy would be a folder; name a file, as" in whole.stderr
    assert not (tmp_path / "copy").exists()
