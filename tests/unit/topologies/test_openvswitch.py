"""Open vSwitch that is missing, that does not start, or whose daemon ends."""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from limits import SOON_S

from topologies.system import namespaces
from topologies.system.kernel import interfaces
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes import commands
from topologies.system.processes.programs import NetworkError, Program

Install = Callable[[str, str], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Return what puts a shell script in the place of a command."""
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")

    def put(name: str, script: str) -> None:
        command = tmp_path / name
        command.write_text(f"#!/bin/sh\n{script}\n")
        command.chmod(0o755)

    return put


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let it be a run's own, in this folder."""
    monkeypatch.setattr(openvswitch, "RUN_FOLDER", tmp_path / "run")
    monkeypatch.setattr(openvswitch, "SOCKET", tmp_path / "run" / "db.sock")
    monkeypatch.setattr(openvswitch, "DATABASE_FILE", tmp_path / "etc" / "conf.db")
    monkeypatch.setattr(namespaces, "are_own", lambda: True)
    monkeypatch.setattr(commands, "COMMAND_LOOK_S", 0.01)
    yield
    openvswitch.end()


def test_one_that_is_not_installed_is_named_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(NetworkError, match="not installed; run `make setup`"):
        openvswitch.start(lambda name: Program(name, Path("/dev/null")))
    with pytest.raises(NetworkError, match="ovs-vsctl is not installed"):
        openvswitch.vsctl("show")


def test_without_namespaces_that_of_the_machine_must_run(
    install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    install("ovs-vsctl", "exit 1")
    monkeypatch.setattr(namespaces, "are_own", lambda: False)
    with pytest.raises(NetworkError, match="does not run on this machine: start it"):
        openvswitch.start(lambda name: Program(name, Path("/dev/null")))


def test_a_command_without_that_of_the_machine_says_how_to_start_it(
    install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in Mininet's own program; where it runs, the command's own words are kept."""
    install("ovs-vsctl", "echo cannot do it >&2; exit 1")
    monkeypatch.setattr(namespaces, "are_own", lambda: False)
    with pytest.raises(NetworkError, match="start it by `sudo service openvswitch-switch start`"):
        openvswitch.vsctl("add-br", "s1")
    openvswitch.SOCKET.parent.mkdir()
    openvswitch.SOCKET.touch()
    with pytest.raises(NetworkError, match="cannot do it"):
        openvswitch.vsctl("add-br", "s1")


def test_one_that_cannot_start_says_why(install: Install, tmp_path: Path) -> None:
    install("ovs-vsctl", "exit 0")
    install("ovsdb-tool", "exit 0")
    install("ovsdb-server", "echo 'no room for the database' >&2; exit 1")
    with pytest.raises(
        NetworkError, match=r"^ovsdb-server ended at its start: status 1; its log: "
    ):
        openvswitch.start(lambda name: Program(name, tmp_path / f"{name}.log"))


def test_a_command_is_not_waited_for_when_a_daemon_has_died(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install("ovs-vsctl", "exec sleep 600")
    monkeypatch.setattr(openvswitch, "VSCTL_TIMEOUT_S", 2 * SOON_S)
    daemon = Program(openvswitch.SWITCH_DAEMON, tmp_path / "log")
    daemon.start([sys.executable, "-c", "import os; os.abort()"])
    monkeypatch.setitem(openvswitch._own, openvswitch.SWITCH_DAEMON, daemon)
    began = time.monotonic()
    with pytest.raises(NetworkError, match=r"^ovs-vswitchd died in mid-run: killed by SIGABRT"):
        openvswitch.vsctl("add-br", "s1")
    assert time.monotonic() - began < SOON_S


def test_one_that_a_signal_has_stopped_is_named_with_the_remedy(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install("ovs-vsctl", "exec sleep 60")
    monkeypatch.setattr(openvswitch, "STOPPED_DAEMON_S", 0.05)
    daemon = Program(openvswitch.SWITCH_DAEMON, tmp_path / "log")
    stops = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
    daemon.start([sys.executable, "-c", stops])
    monkeypatch.setitem(openvswitch._own, openvswitch.SWITCH_DAEMON, daemon)
    with pytest.raises(NetworkError, match=rf"stopped it; .*`kill -CONT {daemon.pid}`"):
        openvswitch.vsctl("add-br", "s1")


def test_a_bridge_that_was_not_made_is_named_with_the_reason(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interfaces, "TUN", "/dev/null")
    install("ovs-vsctl", "echo no such device")
    openvswitch.RUN_FOLDER.mkdir(exist_ok=True)
    (openvswitch.RUN_FOLDER / "s1.mgmt").touch()
    openvswitch.require_made(["s1"])
    with pytest.raises(NetworkError, match="did not make q1: no such device"):
        openvswitch.require_made(["s1", "q1"])


def test_bridges_of_daemons_that_have_ended_are_not_deleted(
    install: Install, tmp_path: Path
) -> None:
    """They have gone with them; without own daemons those that are named are deleted."""
    asked = tmp_path / "asked"
    install("ovs-vsctl", f'echo "$@" >>{asked}')
    daemon = openvswitch._own["ovsdb-server"] = Program("ovsdb-server", tmp_path / "log")
    daemon.start(["sleep", "60"])
    openvswitch.end()
    assert not daemon.running
    openvswitch.delete("s1")
    assert not asked.exists()
    openvswitch.end()
    openvswitch.delete("s1", "q1")
    assert "--if-exists del-br s1 -- --if-exists del-br q1" in asked.read_text()
