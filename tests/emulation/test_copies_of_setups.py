"""Copies of set-up messages on copper of several switches."""

import re
import subprocess
from pathlib import Path

from fabric_scene import facts, running, session

from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost
from topologies.quantum_topo import QuantumTopo


class TwoHallsTopo(QuantumTopo):
    """alice --- s1 --- q1 --- s2 --- q2 on copper; light by q1 and q2."""

    def build(self) -> None:
        """Join the halls by the copper of q1, which passes packets and copies on."""
        for number in (1, 2):
            self.addSwitch(f"s{number}", cls=ClassicalSwitch)
            self.addSwitch(f"q{number}", cls=OpticalSwitch)
        for one, other in (("s1", "q1"), ("q1", "s2"), ("s2", "q2")):
            self.addLink(one, other)
        for name, hall in (("alice", 1), ("bob", 2), ("charlie", 2)):
            self.addHost(name, cls=QuantumHost, source=name == "charlie")
            self.addLink(name, f"s{hall}")
            self.addFibers(name, f"q{hall}", 2)
        self.addFibers("q1", "q2", 3)


def packets_with_metadata(bridge: str) -> int:
    """Return how many packets of the metadata port a switch's own table has counted."""
    command = ["ovs-ofctl", "-O", "OpenFlow14", "dump-flows", bridge]
    entries = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return sum(
        int(found[1])
        for line in entries.splitlines()
        if "tp_dst=9010" in line and (found := re.search(r"n_packets=(\d+)", line))
    )


def test_each_switch_on_the_way_has_seen_the_setup_before_its_light(tmp_path: Path) -> None:
    with running(TwoHallsTopo, tmp_path, metadata_at_switch="required") as network:
        with session(network, "alice", "bob") as opened:
            assert opened.carry(b"seen by both") == b"seen by both"
            counted = {name: packets_with_metadata(name) for name in ("q1", "q2")}
        assert all(counted.values()), counted
        (granted,) = [each for each in facts(network, "granted") if "copies_ms" in each]
        after_ms = granted["copies_ms"]
        assert isinstance(after_ms, dict)
        assert {name: type(each) for name, each in after_ms.items()} == {"q1": float, "q2": float}
