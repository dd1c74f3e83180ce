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
