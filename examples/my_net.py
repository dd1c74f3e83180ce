"""A network of one's own: any names, here two laboratories with a pair source between them.

    h1 --- q1 === q2 --- h2 (two fibres)
                  ||
                 src

qmn run sdc --topology examples/my_net.py:MyNet --from h1 --to h2
qmn run teleport --topology examples/my_net.py:MyNet --from h1 --to h2
qmn cli examples/my_net.py:MyNet
"""

from qmn.topology import OpticalSwitch, QuantumHost, QuantumTopo


class MyNet(QuantumTopo):
    """Three hosts, two quantum switches a kilometre apart."""

    def build(self, length_km: float = 1.0) -> None:
        """Add nodes and fibres; copper, addresses and the host of the simulator are added to it."""
        self.addHost("h1", cls=QuantumHost)
        self.addHost("h2", cls=QuantumHost)
        self.addHost("src", cls=QuantumHost, source=True)
        self.addSwitch("q1", cls=OpticalSwitch)
        self.addSwitch("q2", cls=OpticalSwitch)
        self.addFibers("h1", "q1")
        self.addFibers("h2", "q2", 2)
        self.addFibers("src", "q2", 2)
        self.addFibers("q1", "q2", 2, length_km=length_km, loss_db_per_km=0.2)


topos = {"my-net": MyNet}
