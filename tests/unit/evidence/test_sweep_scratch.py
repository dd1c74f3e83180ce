"""The temporary folder of a sweep: that of a killed one goes with the next, and no other."""

import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from limits import SOON_S

from evidence.curves.scratch import scratch_folder
from topologies.system.processes.programs import ROOT

SWEEP = """
from evidence.curves.scratch import scratch_folder
with scratch_folder() as folder:
    open(f"{folder}/message", "w").close()
    print(folder, flush=True)
    input()
"""


@pytest.fixture(autouse=True)
def _own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)


def test_only_what_a_killed_sweep_has_left_is_removed(tmp_path: Path) -> None:
    (tmp_path / "qmn-sweep-notes").mkdir()
    command = [sys.executable, "-c", SWEEP]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as sweep:
        assert sweep.stdin is not None
        assert sweep.stdout is not None
        folder = Path(sweep.stdout.readline().strip())
        with scratch_folder() as other:
            assert folder.parent == Path(other).parent == tmp_path
            assert (folder / "message").exists()
        assert not Path(other).exists()
        sweep.kill()
        assert sweep.wait(SOON_S) == -signal.SIGKILL
    assert (folder / "message").exists()
    with scratch_folder():
        assert not folder.exists()
    assert [each.name for each in tmp_path.iterdir()] == ["qmn-sweep-notes"]
