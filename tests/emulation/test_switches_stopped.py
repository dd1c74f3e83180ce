"""A switch that is stopped and started again, as by `switch q1 stop` in the command line."""

from pathlib import Path

import pytest
from conftest import wait_until

from qmn.jobs.transfer import TransferError
from qmn.scripting import QuantumNetwork, start
from topologies.system.open_vswitch import openvswitch


def sends(network: QuantumNetwork) -> bool:
    """Whether bytes get through now."""
    try:
        return network.send("alice", "bob", b"light").data == b"light"
    except TransferError:
        return False


def test_a_switch_that_was_stopped_can_be_started_again(tmp_path: Path) -> None:
    with start("sdc", tmp_path) as network:
        for name in ("q1", "s1"):
            switch = network.net.get(name)
            switch.stop(deleteIntfs=False)
            assert name not in openvswitch.bridges()
            network.check()  # its agent's end is no fault
            if name == "q1":
                with pytest.raises(TransferError, match="q1 is not connected to the controller"):
                    network.send("alice", "bob", b"dark")
            switch.start(network.net.controllers)
            assert name in openvswitch.bridges()
            wait_until(lambda: sends(network), "light again")
            network.check()
