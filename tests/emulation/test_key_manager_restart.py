"""A key manager that is killed and started again: what it has assigned is still to be had."""

from pathlib import Path

from conftest import wait_until
from fabric_scene import running
from test_key_managers import LINK, LOW, Scene

from applications.keys.key_managers import MODULE, KeyService, start_key_managers
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import python


def test_an_assigned_key_survives_a_restart_of_the_key_manager(tmp_path: Path) -> None:
    with running(SdcTopo, tmp_path) as network:
        scene = Scene(network, start_key_managers(network, KeyService([("alice", "bob")], LINK)))
        wait_until(lambda: scene.stored() >= LOW, "keys of alice and bob")
        _status, got = scene.curl("alice", "sae-bob/enc_keys?number=2")
        first, second = got["keys"]
        path = "sae-alice/dec_keys?key_ID="
        assert scene.curl("bob", f"{path}{first['key_ID']}") == (200, {"keys": [first]})
        manager, runtime = scene.managers.programs["bob"], network.runtime
        manager.kill()
        command = [python(), "-m", MODULE, "--config", str(runtime.folder / "kme-bob.json")]
        manager.start(command, network.host("bob").pid, (), runtime.forks())
        manager.wait_for("ready", 20.0, network.check)
        assert scene.curl("bob", f"{path}{first['key_ID']}")[0] == 400  # it was handed out
        assert scene.curl("bob", f"{path}{second['key_ID']}") == (200, {"keys": [second]})
