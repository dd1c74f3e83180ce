"""The network of superdense coding with eve, whom the controller can put on a fibre.

                 c0
                /  \\
  alice ------+    |
  bob -------s1----q1======= alice
  charlie ----+    |======== bob, two fibres
  eve --------+    |======== charlie, two fibres
  ed ---------+    +======== eve, two fibres

  --- copper: TCP/IP         === fibre: photons

    sudo PYTHONPATH=. mn --custom topologies/tapped.py --topo tapped

A policy with [[tap]] (controller_apps/policy/reading.py) says whose light goes by way of her.
"""

from typing import Any

from topologies.fabric import Mininet, controllers, findController
from topologies.sdc import SdcTopo

__all__ = ["Mininet", "TappedTopo", "controllers", "findController", "topos"]


class TappedTopo(SdcTopo):
    """alice, bob, charlie and eve; ed holds the qubits."""

    def build(self, **fiber: Any) -> None:
        super().build(**fiber)
        self.add_host("eve", "10.0.0.5")
        self.join("eve", "q1", 2)


topos = {"tapped": TappedTopo}
