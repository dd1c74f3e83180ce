"""What a network keeps on the machine, and whether a process still runs."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from topologies import runtime
from topologies.runtime import Runtime, alive

GONE = str(2**22 + 1)  # above the largest id of a process that Linux gives


@pytest.fixture
def _no_umask() -> Iterator[None]:
    """Let files have the modes that they are made with."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("_no_umask")
def test_nobody_else_reads_the_folder_of_tokens_and_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    network = Runtime()
    folder = Path(network.socket("dispatcher")).parent
    assert folder == tmp_path / "qmn" / str(os.getpid())
    assert folder.stat().st_mode & 0o777 == 0o700
    keys = Path(network.key_folder("alice")).parent
    assert keys.stat().st_mode & 0o777 == 0o700


def test_a_process_that_runs_is_alive_and_one_that_never_was_is_not() -> None:
    assert alive(str(os.getpid()))
    assert not alive(GONE)


def test_a_process_that_has_ended_and_that_nobody_has_waited_for_is_not_alive() -> None:
    """Its name, between parentheses in the kernel's line, may look like a state."""
    with subprocess.Popen([sys.executable, "-c", "pass"]) as zombie:
        os.waitid(os.P_PID, zombie.pid, os.WEXITED | os.WNOWAIT)  # it stays a zombie
        assert Path("/proc", str(zombie.pid)).exists()
        assert not alive(str(zombie.pid))
