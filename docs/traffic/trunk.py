r"""Hosts on both sides of a trunk of fibres, or channels: what heavy traffic contends for.

    a1 … a6 --- q1 ===== q2 --- b1 … b6

qmn run load --topology docs/traffic/trunk.py:Trunk --source own --idle \
    --from a1,a2,a3,a4,a5,a6 --to b1,b2,b3,b4,b5,b6 --rate-per-s 10 --holding-s 0.2 --sessions 100
"""

from mininet.topo import Topo

from topologies.links import FiberLink
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch, QuantumHost


class Trunk(Topo):
    """Each host has a fibre to its switch; sessions from a side to the other share the trunk."""

    def build(self, fibers: int = 2, hosts: int = 6, channels: int = 1) -> None:
        """Add so many hosts on each side, and so many fibres of channels between the switches."""
        self.addSwitch("s1", cls=ClassicalSwitch, dpid="1")
        self.addHost("sim", cls=DispatcherHost, ip="10.0.0.250/24")
        self.addLink("sim", "s1")
        for side, switch in enumerate(("q1", "q2")):
            self.addSwitch(switch, cls=OpticalSwitch, dpid=f"100{side + 1}")
            self.addLink(switch, "s1")
            for number in range(1, hosts + 1):
                name = f"{'ab'[side]}{number}"
                self.addHost(name, cls=QuantumHost, ip=f"10.0.0.{100 * side + number}/24")
                self.addLink(name, "s1")
                self.addLink(name, switch, cls=FiberLink)
        for _ in range(fibers):
            self.addLink("q1", "q2", cls=FiberLink, channels=channels)


topos = {"trunk": Trunk}
