"""A run over the real components is replayed, and its quantum events run as a circuit."""

import stat
import subprocess
from pathlib import Path

import pytest
from conftest import qmn
from limits import SOON_S
from loaded import run_qmn

DEADLINE_S = SOON_S


def command(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command of qmn that needs no network."""
    return run_qmn(*words, timeout_s=DEADLINE_S)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("handshake", ["framed", "per-pair"])
def test_a_run_with_losses_and_noise_is_identical_when_it_is_replayed(
    tmp_path: Path, handshake: str
) -> None:
    options = ["--loss-db-per-km", "20", "--depolarizing", "0.02", "--handshake", handshake]
    options += ["--frame-bytes", "4", "--block-pairs", "48", "--message", "twice", "--qasm"]
    done = qmn(*options, runs=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    folder = tmp_path / "latest"
    assert stat.S_IMODE((folder / "dispatcher.record").stat().st_mode) == 0o600

    replayed = command("replay", str(folder))
    assert (replayed.returncode, replayed.stderr) == (0, "")
    events = (folder / "quantum.log").read_text().count("\n")
    assert replayed.stdout.startswith(f"identical: {events:,} events of ")

    dump = (folder / "quantum.qasm").read_text()
    assert "charlie: create block" in dump
    assert "Depolarizing in the fibre to" in dump
    ran = command("sabot", "run", str(folder / "quantum.qasm"), "--shots", "1")
    assert (ran.returncode, ran.stderr) == (0, "")
