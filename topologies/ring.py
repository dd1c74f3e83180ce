"""Quantum switches in a ring, joined by two fibres each (s1, ed and copper as in sdc.py).

alice --- q1 === q2 === charlie, two fibres
          ||     ||
          q4 === q3 === bob, two fibres

  sudo PYTHONPATH=. mn --custom topologies/ring.py --topo ring,switches=4
"""

from typing import Any

from topologies.fabric import FabricTopo, Mininet, controllers, findController

__all__ = ["Mininet", "RingTopo", "controllers", "findController", "topos"]


class RingTopo(FabricTopo):
    """Between any two hosts there are two ways."""

    def build(self, switches: int = 4, fibers: int = 2, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: see sdc.py."""
        self.add_classical_network(**fiber)
        names = self.add_quantum_switches(int(switches), least=3)
        self.place(names[0], names[2], names[1])
        for one, other in zip(names, [*names[1:], names[0]], strict=True):
            self.join(one, other, int(fibers))


topos = {"ring": RingTopo}
