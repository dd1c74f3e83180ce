r"""Hosts on both sides of a trunk of fibres, or channels: what heavy traffic contends for.

    a1 … a6 --- q1 ===== q2 --- b1 … b6

qmn run load --topology docs/traffic/trunk.py:Trunk --source own --idle \
    --from a1,a2,a3,a4,a5,a6 --to b1,b2,b3,b4,b5,b6 --rate-per-s 10 --holding-s 0.2 --sessions 100
"""

from topologies.nodes import OpticalSwitch, QuantumHost
from topologies.quantum_topo import QuantumTopo


class Trunk(QuantumTopo):
    """Each host has a fibre to its switch; sessions from a side to the other share the trunk."""

    def build(self, fibers: int = 2, hosts: int = 6, channels: int = 1) -> None:
        """Add this number of hosts on each side, and of fibres of channels between the switches."""
        for side, switch in (("a", "q1"), ("b", "q2")):
            self.addSwitch(switch, cls=OpticalSwitch)
            for number in range(1, hosts + 1):
                self.addHost(f"{side}{number}", cls=QuantumHost)
                self.addFibers(f"{side}{number}", switch)
        self.addFibers("q1", "q2", fibers, channels=channels)


topos = {"trunk": Trunk}
