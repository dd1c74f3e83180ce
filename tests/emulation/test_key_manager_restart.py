"""A key manager that is killed and started again: what it has assigned is still to be had."""

from pathlib import Path

from conftest import wait_until
from fabric_scene import running
from key_scene import LOW, Keys, keep_keys

from applications.keys.key_managers import MODULE
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import python


def test_an_assigned_key_survives_a_restart_of_the_key_manager(tmp_path: Path) -> None:
    with running(SdcTopo, tmp_path, contention="queue") as network:
        keep_keys(network)
        keys = Keys(network)
        wait_until(lambda: keys.stored() >= LOW, "keys of alice and charlie")
        _status, got = keys.curl("alice", "sae-charlie/enc_keys?number=2")
        first, second = got["keys"]
        path = "sae-alice/dec_keys?key_ID="
        assert keys.curl("charlie", f"{path}{first['key_ID']}") == (200, {"keys": [first]})
        manager, runtime = keys.manager("charlie"), network.runtime
        manager.kill()
        command = [python(), "-m", MODULE, "--config", str(runtime.folder / "kme-charlie.json")]
        manager.start(command, network.host("charlie").pid, (), runtime.forks())
        manager.wait_for("ready", 20.0, network.check)
        assert keys.curl("charlie", f"{path}{first['key_ID']}")[0] == 400  # it was handed out
        assert keys.curl("charlie", f"{path}{second['key_ID']}") == (200, {"keys": [second]})
