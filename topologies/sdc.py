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

from typing import Any

from topologies.fabric import FabricTopo, Mininet, controllers, findController

__all__ = ["Mininet", "SdcTopo", "controllers", "findController", "topos"]


class SdcTopo(FabricTopo):
    """alice and bob, with charlie's pairs; ed holds the qubits."""

    def build(self, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: `preset`, or FiberOptics."""
        self.add_classical_network(**fiber)
        (q1,) = self.add_quantum_switches(1)
        self.place(q1, q1, q1)


topos = {"sdc": SdcTopo}
