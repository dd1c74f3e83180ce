"""A fabric of two stages: every leaf is joined to every spine (s1, ed and copper as in sdc.py).

            q4      q5         spines, each joined to every leaf
           / | \\   / | \\
         q1    q2    q3        leaves
         |     ||    ||
      alice charlie bob

    sudo PYTHONPATH=. mn --custom topologies/leaf_spine.py --topo leaf_spine,leaves=3,spines=2
"""

from typing import Any

from topologies.fabric import FabricTopo, Mininet, controllers, findController

__all__ = ["LeafSpineTopo", "Mininet", "controllers", "findController", "topos"]


class LeafSpineTopo(FabricTopo):
    """Hosts at the leaves; between two leaves there is a way by each spine."""

    def build(self, leaves: int = 3, spines: int = 2, fibers: int = 1, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: see sdc.py."""
        self.add_classical_network(**fiber)
        leaves, spines = int(leaves), int(spines)
        if leaves < 1 or spines < 1:
            raise ValueError(f"{leaves} leaves and {spines} spines: choose 1 or more of each")
        names = self.add_quantum_switches(leaves + spines)
        self.place(names[0], names[leaves - 1], names[(leaves - 1) // 2])
        for leaf in names[:leaves]:
            for spine in names[leaves:]:
                self.join(leaf, spine, int(fibers))


topos = {"leaf_spine": LeafSpineTopo}
