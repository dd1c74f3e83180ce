"""qmn apart: a network beside another one on the same machine."""

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, qmn, wait_until
from limits import SOON_S

from topologies.networks.network import Network

QMN = str(ROOT / "bin" / "qmn")
BESIDE = "import sys; from qmn.verbs.apart import beside; sys.exit(beside(sys.argv[1:]))"
COUNTS_SIGINT = """
import signal, sys
got = []
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
print("ready", flush=True)
while (number := signal.sigwait({signal.SIGINT, signal.SIGTERM})) == signal.SIGINT:
    got.append(number)
    print("interrupted", flush=True)
sys.exit(len(got))
"""


def test_a_network_runs_beside_another_and_can_be_looked_at_and_ended(
    shared_network: Network, tmp_path: Path
) -> None:
    refused = qmn(runs=tmp_path / "refused")
    assert "qmn apart" in refused.stderr
    ours = subprocess.check_output(["ovs-vsctl", "list-br"])
    reader, writer = os.pipe()
    command = [QMN, "apart", "cli", "ring", "--switches", "3", "--runs", str(tmp_path)]
    process = subprocess.Popen(command, stdin=reader, stdout=subprocess.DEVNULL, cwd=ROOT)
    os.close(reader)

    def says(*words: str) -> subprocess.CompletedProcess[str]:
        enter = [QMN, "apart", "--of", str(process.pid), *words]
        return subprocess.run(enter, capture_output=True, text=True, check=False, timeout=SOON_S)

    try:
        wait_until(lambda: "q3" in says("devices").stdout, "its third switch is seen")
        assert (
            "q3"
            not in subprocess.run(
                [QMN, "devices"], capture_output=True, text=True, check=True, timeout=SOON_S
            ).stdout
        )
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.wait()
        os.close(writer)
    assert "is not a `qmn apart` that runs" in says("devices").stderr
    shared_network.check()
    assert subprocess.check_output(["ovs-vsctl", "list-br"]) == ours


@pytest.mark.parametrize("by_terminal", [False, True])
def test_what_is_apart_is_interrupted_once(by_terminal: bool) -> None:
    """A terminal interrupts all programs at it; who interrupts one by its id means what it runs."""
    keyboard, terminal = pty.openpty()
    command = [sys.executable, "-c", BESIDE, sys.executable, "-c", COUNTS_SIGINT]
    process = subprocess.Popen(
        ["setsid", "--ctty", *command] if by_terminal else command,
        stdin=terminal,
        stdout=subprocess.PIPE,
        cwd=ROOT,
        text=True,
    )
    os.close(terminal)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "ready\n"
        if by_terminal:
            os.write(keyboard, b"\x03")
        else:
            process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 1
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        os.close(keyboard)
