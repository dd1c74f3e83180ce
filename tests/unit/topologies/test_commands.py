"""Commands of other packages: how they end, and their errors."""

import subprocess
import sys
from pathlib import Path

import pytest
from limits import wait_until

from topologies.system.processes.commands import run
from topologies.system.processes.owners import owner
from topologies.system.processes.programs import ROOT, NetworkError


def test_a_command_ends_with_the_process_that_is_killed_while_it_waits(tmp_path: Path) -> None:
    """Else it would go on beside the next run, and start what that has just stopped."""
    file = tmp_path / "pid"
    command = ["sh", "-c", f"echo $$ >{file}; exec sleep 60"]
    waiting = f"""
from topologies.system.processes.commands import run
run(*{command!r}, timeout_s=60)
"""
    with subprocess.Popen([sys.executable, "-c", waiting], cwd=ROOT) as process:
        try:
            wait_until(lambda: file.exists() and file.read_text().endswith("\n"), "it began")
            started = owner(int(file.read_text()))
        finally:
            process.kill()
    assert started is not None
    wait_until(lambda: not started.alive, "it ends")


def test_what_is_not_installed_and_what_fails_is_told_by_its_own_name() -> None:
    with pytest.raises(NetworkError, match="no-such is not installed; run `make setup`"):
        run("no-such", timeout_s=5)
    with pytest.raises(NetworkError, match=r"^sh -c exit 3 failed: $"):
        run("sh", "-c", "exit 3", timeout_s=5)
    assert run("cat", text="text", timeout_s=5) == "text"
