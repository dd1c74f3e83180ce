"""A network of one's own: any names, here two laboratories with a pair source between them.

    h1 --- q1 === q2 --- h2 (two fibres)
                  ||
                 src

qmn run sdc --topology examples/my_net.py:MyNet --from h1 --to h2
qmn run teleport --topology examples/my_net.py:MyNet --from h1 --to h2
qmn cli examples/my_net.py:MyNet
"""

from mininet.topo import Topo

from topologies.links import FiberLink
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch, QuantumHost


class MyNet(Topo):
    """Three hosts, two quantum switches a kilometre apart."""

    def build(self, length_km: float = 1.0) -> None:
        """Add nodes, copper to hub, and fibres."""
        self.addSwitch("hub", cls=ClassicalSwitch, dpid="1")
        self.addHost("sim", cls=DispatcherHost, ip="10.0.0.100/24")
        for number, name in enumerate(["h1", "h2", "src"], 1):
            self.addHost(name, cls=QuantumHost, ip=f"10.0.0.{number}/24", source=name == "src")
        for number in (1, 2):
            self.addSwitch(f"q{number}", cls=OpticalSwitch, dpid=f"100{number}")
        for node in ("sim", "h1", "h2", "src", "q1", "q2"):
            self.addLink(node, "hub")
        for one, other, fibers in [("h1", "q1", 1), ("h2", "q2", 2), ("src", "q2", 2)]:
            for _ in range(fibers):
                self.addLink(one, other, cls=FiberLink)
        for _ in range(2):
            self.addLink("q1", "q2", cls=FiberLink, length_km=length_km, loss_db_per_km=0.2)


topos = {"my-net": MyNet}
