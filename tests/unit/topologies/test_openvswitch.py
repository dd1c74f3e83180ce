"""Open vSwitch that is missing or will not start."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from topologies.system.open_vswitch import openvswitch
from topologies.system.processes import commands
from topologies.system.processes.owners import Owner, owner, this_process
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
    monkeypatch.setattr(openvswitch, "RUNTIME_ROOT", tmp_path)
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
    monkeypatch.setattr(openvswitch, "_mark_of", {here: "run"}.get)
    (tmp_path / openvswitch.STARTED).write_text(f"run\n{here}")
    with pytest.raises(NetworkError, match=r"ovs-ctl stop failed"):
        openvswitch.stop_if_ours("run")
    assert openvswitch.starter() == "run"


GONE, OTHER = "4194304-1-00000000", "4194303-1-00000000"  # no process has these ids


@pytest.mark.parametrize(
    ("mark", "noted", "starter"),
    [
        ("run", "run", "run"),
        ("run", "another", "run"),  # a note that has been left, or put back
        ("run", GONE, "run"),
        (GONE, "run", "run"),  # which has taken them over
        ("", "run", ""),  # the machine's own, started beside a run
        (GONE, "", GONE),
    ],
)
def test_the_mark_of_living_daemons_says_who_has_started_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mark: str, noted: str, starter: str
) -> None:
    environment = {"PATH": os.environ["PATH"], **({openvswitch.STARTER: mark} if mark else {})}
    pipe = subprocess.PIPE
    with subprocess.Popen(["cat"], 0, env=environment, stdin=pipe, stdout=pipe) as daemon:
        try:
            assert daemon.stdin
            assert daemon.stdout
            daemon.stdin.write(b"x")
            assert daemon.stdout.read(1) == b"x"  # it runs, and has its environment
            found = owner(daemon.pid)
            assert found
            monkeypatch.setattr(openvswitch, "RUNTIME_ROOT", tmp_path)
            monkeypatch.setattr(openvswitch, "daemons", lambda: {openvswitch.DATABASE: found})
            if noted:
                (tmp_path / openvswitch.STARTED).write_text(f"{noted}\n{found}")
            assert openvswitch.starter() == starter
        finally:
            daemon.kill()


def test_a_note_about_other_daemons_says_nothing_of_these(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = this_process()
    monkeypatch.setattr(openvswitch, "RUNTIME_ROOT", tmp_path)
    monkeypatch.setattr(openvswitch, "daemons", lambda: {openvswitch.DATABASE: here})
    monkeypatch.setattr(openvswitch, "_mark_of", {here: GONE}.get)
    (tmp_path / openvswitch.STARTED).write_text(f"run\n{OTHER}")
    assert openvswitch.starter() == GONE
