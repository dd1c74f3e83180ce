"""Open vSwitch that is missing or will not start."""

from pathlib import Path

import pytest

from topologies import openvswitch
from topologies.programs import NetworkError


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
    with pytest.raises(NetworkError, match=r"ovs-ctl start .* failed: no room for the database"):
        openvswitch.start("test")


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
