"""Quantum switches in a line, joined by two fibres each (s1, ed and copper as in sdc.py).

alice --- q1 === q2 === q3 === bob, two fibres
                 ||
               charlie, two fibres

  sudo PYTHONPATH=. mn --custom topologies/chain.py --topo chain,switches=3
"""

from itertools import pairwise
from typing import Any

from topologies.fabric import FabricTopo, Mininet, controllers, findController

__all__ = ["ChainTopo", "Mininet", "controllers", "findController", "topos"]


class ChainTopo(FabricTopo):
    """alice and bob at the ends, charlie's pairs in the middle."""

    def build(self, switches: int = 3, fibers: int = 2, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: see sdc.py."""
        self.add_classical_network(**fiber)
        names = self.add_quantum_switches(int(switches))
        self.place(names[0], names[-1], names[(len(names) - 1) // 2])
        for one, other in pairwise(names):
            self.join(one, other, int(fibers))


topos = {"chain": ChainTopo}
