"""Superdense coding: three quantum hosts, one quantum switch, one classical switch.

                 c0
                /  \\
  alice ------+    |
  bob -------s1----q1======= alice
  charlie ----+    |======== bob, two fibres
  ed ---------+    +======== charlie, two fibres

  --- copper: TCP/IP         === fibre: photons

    sudo PYTHONPATH=. mn --custom topologies/sdc.py --topo sdc
"""

from mininet.topo import Topo

from topologies.fiber import FiberLink
from topologies.nodes import (
    ClassicalSwitch,
    DispatcherHost,
    OpticalSwitch,
    QuantumController,
    QuantumHost,
)


class SdcTopo(Topo):
    """alice and bob, with charlie's pairs; ed holds the qubits."""

    def build(
        self,
        length_km: float = 0.01,
        loss_db_per_km: float = 0.0,
        depolarizing: float = 0.0,
    ) -> None:
        """Lay copper and fibre; every fibre is alike."""
        s1 = self.addSwitch("s1", cls=ClassicalSwitch, dpid="1")
        q1 = self.addSwitch("q1", cls=OpticalSwitch, dpid="1001")
        ed = self.addHost("ed", cls=DispatcherHost, ip="10.0.0.4/24")
        alice = self.addHost("alice", cls=QuantumHost, ip="10.0.0.1/24")
        bob = self.addHost("bob", cls=QuantumHost, ip="10.0.0.2/24")
        charlie = self.addHost("charlie", cls=QuantumHost, ip="10.0.0.3/24", source=True)
        for host in (alice, bob, charlie, ed):
            self.addLink(host, s1)
        self.addLink(s1, q1)
        fiber = {
            "cls": FiberLink,
            "length_km": float(length_km),
            "loss_db_per_km": float(loss_db_per_km),
            "depolarizing": float(depolarizing),
        }
        for host in (alice, bob, bob, charlie, charlie):
            self.addLink(host, q1, **fiber)


def findController() -> type[QuantumController]:  # noqa: N802
    """Tell `mn` which controller is the default: it takes its own names from this file."""
    return QuantumController


topos = {"sdc": SdcTopo}
controllers = {"quantum": QuantumController}
