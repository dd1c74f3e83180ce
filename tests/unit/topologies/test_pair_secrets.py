"""What every two hosts of a network share, and where their keys go."""

from pathlib import Path

import pytest

from topologies import runtime
from topologies.runtime import Runtime
from wire.parameters.network import NetworkSettings
from wire.parameters.physics import Device


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runtime:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "run")
    return Runtime(devices={name: Device() for name in ("alice", "bob", "charlie")})


def test_two_hosts_have_a_secret_of_their_own_and_both_are_told_it(network: Runtime) -> None:
    told = {host: network.secrets_of(host) for host in network.devices}
    assert told["alice"].keys() == {"bob", "charlie"}
    secrets = set()
    for host, others in told.items():
        for other, secret in others.items():
            assert told[other][host] == secret
            assert len(bytes.fromhex(secret)) == 32
            secrets.add(secret)
    assert len(secrets) == 3


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
