"""Every run has namespaces of its own: runs beside each other, a command inside one, its end."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from conftest import ROOT, interfaces, wait_until
from limits import SOON_S

from topologies.system import namespaces

QMN = str(ROOT / "bin" / "qmn")


@contextmanager
def command_line(folder: Path, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Run `qmn cli` until the end of this context at the latest."""
    reader, writer = os.pipe()
    command = [QMN, "cli", *words, "--runs", str(folder)]
    with subprocess.Popen(command, stdin=reader, stdout=subprocess.DEVNULL, cwd=ROOT) as process:
        os.close(reader)
        try:
            yield process
        finally:
            process.kill()
            os.close(writer)


def qmn(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [QMN, *words], capture_output=True, text=True, check=False, timeout=SOON_S
    )


def test_runs_go_on_beside_each_other_and_each_can_be_entered(tmp_path: Path) -> None:
    assert "no network runs" in qmn("devices").stderr
    before = interfaces()
    with (
        command_line(tmp_path / "one", "ring,3") as ring,
        command_line(tmp_path / "two", "sdc") as sdc,
    ):
        enter_ring = ("enter", "--run", str(ring.pid))
        enter_sdc = ("enter", "--run", str(sdc.pid))
        wait_until(lambda: "q3" in qmn(*enter_ring, "qmn", "devices").stdout, "the ring")
        wait_until(lambda: "q1" in qmn(*enter_sdc, "qmn", "devices").stdout, "the other")
        assert "q3" not in qmn(*enter_sdc, "qmn", "devices").stdout
        assert qmn(*enter_sdc, "ovs-vsctl", "list-br").stdout.split() == ["q1", "s1"]
        refused = qmn("devices")
        assert refused.returncode == 1
        assert f"choose one, as in `qmn enter --run {min(ring.pid, sdc.pid)}" in refused.stderr
        assert interfaces() == before
        ring.send_signal(signal.SIGTERM)
        assert ring.wait(30) == 128 + signal.SIGTERM
        assert "q1" in qmn("devices").stdout
    assert f"no network of process {sdc.pid} runs" in qmn(*enter_sdc, "true").stderr


def test_what_a_killed_run_has_started_ends_with_it(tmp_path: Path) -> None:
    with command_line(tmp_path, "sdc") as process:
        wait_until(lambda: "q1" in qmn("devices").stdout, "the network")
        (run,) = namespaces.running()
        process.send_signal(signal.SIGKILL)
        process.wait(30)
        wait_until(lambda: not Path(f"/proc/{run.first}").exists(), "all ends with it")
    assert namespaces.running() == []


STARTS_ONE = """
from qmn.scripting import start
with start("sdc", folder={folder!r}):
    pass
"""
CHANGED = ("tcp_wmem", "tcp_synack_retries", "tcp_congestion_control")


def test_the_tcp_of_the_machine_stays_as_it_is(tmp_path: Path) -> None:
    """So a notebook's network is paced, as Jupyter is in the machine's network."""
    kernel = Path("/proc/sys/net/ipv4")
    before = [(kernel / name).read_text() for name in CHANGED]
    script = STARTS_ONE.format(folder=str(tmp_path / "run"))
    command = [str(namespaces.OWN_NAMESPACES), "--network-of-machine", sys.executable, "-c", script]
    done = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=SOON_S,
    )
    assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "run" / "result.json").read_text())
    assert facts["time"] == "paced"
    assert "TCP of this machine" in facts["time_because"]
    assert [(kernel / name).read_text() for name in CHANGED] == before
