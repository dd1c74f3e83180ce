"""Hosts in a line, a quantum switch between neighbours (s1, ed and copper as in sdc.py).

alice --- q1 --- r1 --- q2 --- r2 --- q3 --- bob

  sudo PYTHONPATH=. mn --custom topologies/repeaters.py --topo repeaters,repeaters=2
"""

from itertools import pairwise
from typing import Any

from topologies.fabric import FabricTopo, Mininet, controllers, findController

__all__ = ["Mininet", "RepeatersTopo", "controllers", "findController", "topos"]

MOST = 64


class RepeatersTopo(FabricTopo):
    """No light goes from alice to bob: each host shares states with the next."""

    def build(self, repeaters: int = 1, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: see sdc.py."""
        count = int(repeaters)
        if not 1 <= count <= MOST:
            raise ValueError(f"{count} repeaters: choose 1 to {MOST}")
        self.add_classical_network(source="alice", **fiber)
        names = [f"r{number}" for number in range(1, count + 1)]
        for number, name in enumerate(names, 1):
            self.add_host(name, f"10.0.0.{10 + number}")
        switches = self.add_quantum_switches(count + 1)
        for switch, (left, right) in zip(switches, pairwise(["alice", *names, "bob"]), strict=True):
            self.join(left, switch, 1)
            self.join(right, switch, 1)


topos = {"repeaters": RepeatersTopo}
