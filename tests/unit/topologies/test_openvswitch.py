"""Open vSwitch that is missing or will not start."""

import time
from pathlib import Path

import pytest

from topologies.system.open_vswitch import openvswitch
from topologies.system.processes import commands
from topologies.system.processes.owners import Owner, this_process
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import VSCTL_TIMEOUT_S


def test_one_that_is_not_installed_is_named_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(openvswitch, "CONTROL", "/nowhere/ovs-ctl")
    with pytest.raises(NetworkError, match="not installed; run `make setup`"):
        openvswitch.start("test")


def test_one_that_cannot_start_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    control = tmp_path / "ovs-ctl"
    control.write_text("#!/bin/sh\necho 'no room for the database' >&2\nexit 1\n")
    control.chmod(0o755)
    monkeypatch.setattr(openvswitch, "CONTROL", str(control))
    monkeypatch.setattr(openvswitch, "RUN_FOLDER", tmp_path)  # whatever runs on this machine
    monkeypatch.setattr(openvswitch, "_watched_over", set)
    monkeypatch.setattr(openvswitch, "running", lambda: False)
    with pytest.raises(NetworkError, match=r"ovs-ctl start .* failed: no room for the database"):
        openvswitch.start("test")


def test_it_is_started_again_where_a_daemon_was_just_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Then ovs-ctl has taken that for one that runs, and started nothing."""
    control, starts = tmp_path / "ovs-ctl", tmp_path / "starts"
    control.write_text(f"#!/bin/sh\necho start >>{starts}\n")
    control.chmod(0o755)
    monkeypatch.setattr(openvswitch, "CONTROL", str(control))
    monkeypatch.setattr(openvswitch, "RUNTIME_ROOT", tmp_path)
    monkeypatch.setattr(openvswitch, "daemons", dict)
    monkeypatch.setattr(openvswitch, "OPENVSWITCH_TIMEOUT_S", 5.0)
    starts.touch()
    monkeypatch.setattr(openvswitch, "running", lambda: starts.read_text().count("start") > 1)
    watched = iter(
        [{openvswitch.SWITCH_DAEMON}] * 3
    )  # its monitor starts it again: no one else may
    asked = []

    def watched_over() -> set[str]:
        asked.append(starts.read_text())
        return next(watched, set())

    monkeypatch.setattr(openvswitch, "_watched_over", watched_over)
    openvswitch.start("test")
    assert asked == ["", "", "", "", "start\n"]
    assert (tmp_path / openvswitch.STARTED).read_text() == "test"


def test_a_command_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(NetworkError, match="not installed"):
        openvswitch.running()
    with pytest.raises(NetworkError, match="ovs-vsctl is not installed"):
        openvswitch.vsctl("show")


def test_a_database_that_is_ending_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = "ovs-vsctl: unix:db.sock: database connection failed (Connection refused)"
    command = tmp_path / "ovs-vsctl"
    command.write_text(f"#!/bin/sh\necho '{words}' >&2\nexit 1\n")
    command.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin")
    monkeypatch.setattr(openvswitch, "daemons", dict)  # none is seen to be stopped or missing
    with pytest.raises(NetworkError, match=r"^ovsdb-server does not answer: .*refused"):
        openvswitch.vsctl("list-br")


def test_a_command_is_not_waited_for_when_a_daemon_has_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = tmp_path / "ovs-vsctl"
    command.write_text("#!/bin/sh\nexec sleep 60\n")
    command.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setattr(commands, "COMMAND_LOOK_S", 0.01)
    monkeypatch.setattr(openvswitch, "LAST_WORDS_TIMEOUT_S", 0.0)
    dead = {openvswitch.SWITCH_DAEMON: Owner(1, 0, "00000000")}
    monkeypatch.setattr(openvswitch, "daemons", lambda: dead)
    began = time.monotonic()
    with pytest.raises(NetworkError, match=r"^ovs-vswitchd died in mid-run: "):
        openvswitch.vsctl("add-br", "s1")
    assert time.monotonic() - began < VSCTL_TIMEOUT_S / 2


def test_who_has_started_it_is_known_until_it_has_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    control = tmp_path / "ovs-ctl"
    control.write_text("#!/bin/sh\nexit 1\n")  # as one that was ended when half was stopped
    control.chmod(0o755)
    monkeypatch.setattr(openvswitch, "CONTROL", str(control))
    monkeypatch.setattr(openvswitch, "RUNTIME_ROOT", tmp_path)
    monkeypatch.setattr(openvswitch, "running", lambda: True)
    monkeypatch.setattr(openvswitch, "bridges", list)
    here = this_process()
    monkeypatch.setattr(openvswitch, "daemons", lambda: {openvswitch.DATABASE: here})
    (tmp_path / openvswitch.STARTED).write_text(f"run\n{here}")
    with pytest.raises(NetworkError, match=r"ovs-ctl stop failed"):
        openvswitch.stop_if_ours("run")
    assert openvswitch.starter() == "run"
