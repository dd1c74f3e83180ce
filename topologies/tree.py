"""Quantum switches in a tree, hosts at each of them (s1, ed and copper as in sdc.py).

                   q1 --- alice, h6, …
              /         \\
      bob --- q2   …     q5 --- h5, …
           /    \\
         q6  …   q9

    sudo PYTHONPATH=. mn --custom topologies/tree.py --topo tree,hosts=16,switches=5
"""

from ipaddress import IPv4Address
from itertools import cycle
from typing import Any

from topologies.fabric import FabricTopo, Mininet, controllers, findController

__all__ = ["Mininet", "TreeTopo", "controllers", "findController", "topos"]

LEAST_HOSTS, MOST_HOSTS = 3, 1024
BRANCHES = 4  # below each switch
FIBERS = 2  # from a host to its switch, and from one switch to the next
FIRST_ADDRESS = IPv4Address("10.0.0.5")  # of the first host after ed


class TreeTopo(FabricTopo):
    """Any two hosts can be joined, over as many switches as it takes; charlie makes the pairs."""

    def build(self, hosts: int = 16, switches: int = 5, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: see sdc.py."""
        count = int(hosts)
        if not LEAST_HOSTS <= count <= MOST_HOSTS:
            raise ValueError(f"{count} hosts: choose {LEAST_HOSTS} to {MOST_HOSTS}")
        self.add_classical_network(addresses=count, **fiber)
        names = ["alice", "bob", "charlie", *(f"h{number}" for number in range(4, count + 1))]
        for number, name in enumerate(names[3:]):
            self.add_host(name, str(FIRST_ADDRESS + number))
        tree = self.add_quantum_switches(int(switches))
        for number, switch in enumerate(tree[1:]):
            self.join(tree[number // BRANCHES], switch, FIBERS)
        for name, switch in zip(names, cycle(tree), strict=False):
            self.join(name, switch, FIBERS)


topos = {"tree": TreeTopo}
