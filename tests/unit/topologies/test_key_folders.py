"""Where hosts find each other, what they share, and where their keys go."""

import json
from pathlib import Path

import pytest

from topologies.system.runs import runtime
from topologies.system.runs.runtime import Runtime
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import Device


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runtime:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "run")
    return Runtime(devices={name: Device() for name in ("alice", "bob", "charlie")})


def test_all_hosts_are_in_one_file_with_those_that_came_later(network: Runtime) -> None:
    network.addresses["alice"] = "10.0.0.1"
    assert json.loads(Path(network.hosts_file()).read_text()) == {"alice": "10.0.0.1"}
    network.addresses["bob"] = "10.0.0.2"
    assert json.loads(Path(network.hosts_file()).read_text())["bob"] == "10.0.0.2"


def test_what_hosts_share_is_in_a_private_folder(network: Runtime) -> None:
    assert Path(network.secrets_folder()).stat().st_mode & 0o777 == 0o700


def test_keys_go_with_the_network_unless_they_are_to_stay(network: Runtime, tmp_path: Path) -> None:
    folder = Path(network.key_folder("alice"))
    assert folder.parent.parent == network.folder
    network.settings = NetworkSettings(keys=str(tmp_path / "kept"))
    kept = Path(network.key_folder("bob"))
    assert kept == tmp_path / "kept" / "bob"
    for private in (folder.parent, folder, kept.parent, kept):
        assert private.stat().st_mode & 0o777 == 0o700
    network.remove()
    assert not folder.exists()
    assert kept.parent.exists()
