"""Open vSwitch's daemons end or stop in the middle of a run: each is named, and nothing stays."""

import os
import shutil
import signal
import socket
import subprocess
import threading
from pathlib import Path

import pytest
from conftest import ROOT, wait_until
from fabric_scene import running
from mininet.node import Controller
from test_faults import child, long_run, read_until

from topologies.nodes import OpticalSwitch
from topologies.sdc import SdcTopo
from topologies.system import namespaces
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError, Program

DAEMONS = openvswitch.DATABASE, openvswitch.SWITCH_DAEMON
ENDS_IN_S = 20  # with clean-up; the wait ends much sooner


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize("daemon", DAEMONS)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGSEGV])
def test_a_daemon_that_ends_is_named(tmp_path: Path, daemon: str, number: signal.Signals) -> None:
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        os.kill(child(process, daemon), number)
        output = process.finish(ENDS_IN_S)
    assert process.returncode == 1
    assert f"qmn: {daemon} died in mid-run: killed by {number.name}" in output


def test_a_switch_daemon_that_ends_as_an_agent_starts_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The agent ends first: the daemon's sockets close a moment before it has ended itself."""
    launch = OpticalSwitch.launch

    def end_after(agent: Program) -> None:
        wait_until(lambda: not agent.running, "the agent has ended")
        os.kill(openvswitch.switch_daemon_pid(), signal.SIGKILL)

    def struck(switch: OpticalSwitch, controllers: list[Controller]) -> None:
        if switch.program is None:
            (listens_no_more := openvswitch.management(switch.name)).unlink()
            with socket.socket(socket.AF_UNIX) as closed:
                closed.bind(str(listens_no_more))
            launch(switch, controllers)
            threading.Thread(target=end_after, args=(switch.program,)).start()

    monkeypatch.setattr(OpticalSwitch, "launch", struck)
    with (
        pytest.raises(NetworkError, match=r"^ovs-vswitchd died in mid-run: .*killed"),
        running(SdcTopo, tmp_path),
    ):
        pytest.fail("it has started")


@pytest.mark.waits
@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("daemon", DAEMONS)
def test_a_daemon_that_a_signal_has_stopped_is_named(tmp_path: Path, daemon: str) -> None:
    with long_run(tmp_path) as process:
        read_until(process, "sending")
        os.kill(child(process, daemon), signal.SIGSTOP)
        output = process.finish(40)
    assert process.returncode == 1
    assert f"qmn: {daemon} does not answer: a signal has stopped it (SIGSTOP)" in output


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("folder", ["run/openvswitch", "etc/openvswitch"])
def test_a_run_whose_files_of_open_vswitch_are_removed_ends_in_time(
    tmp_path: Path, folder: str
) -> None:
    """A service that is stopped or upgraded may remove them; a daemon's handle is what counts."""
    command = [str(ROOT / "bin" / "qmn"), "cli", "sdc", "--runs", str(tmp_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        try:
            wait_until(namespaces.running, "its namespaces")
            (run,) = namespaces.running()
            files = Path(f"/proc/{run.first}/root")
            wait_until(lambda: [*files.glob("run/qmn/*/network.json")], "the network")
            for left in (files / folder).iterdir():
                shutil.rmtree(left) if left.is_dir() else left.unlink()
            output, _ = process.communicate("alice ping -c1 10.0.0.2\nexit\n", ENDS_IN_S)
        finally:
            process.kill()
    assert "1 received" in output
    assert process.returncode == 0
