"""Repeaters in a line, a quantum switch between neighbours (s1, ed and copper as in sdc.py).

alice --- q1 --- r1 --- q2 --- r2 --- q3 --- bob
         |  |          |  |          |  |
          m1            m2            m3          with stations

  sudo PYTHONPATH=. mn --custom topologies/repeaters.py --topo repeaters,repeaters=2
"""

from itertools import pairwise
from typing import Any

from topologies.catalogue.node_kinds import STATION
from topologies.fabric import FabricTopo, Mininet, controllers, findController
from wire.device import MAX_REPEATERS

__all__ = ["Mininet", "RepeatersTopo", "controllers", "findController", "topos"]


class RepeatersTopo(FabricTopo):
    """No light goes from alice to bob: pairs come by swaps."""

    def build(self, repeaters: int = 1, stations: bool = False, **fiber: Any) -> None:
        """Lay copper and fibre; every fibre is alike: see sdc.py.

        Stations herald pairs of memories that emit, one for each link.
        """
        count = int(repeaters)
        if not 1 <= count <= MAX_REPEATERS:
            raise ValueError(f"{count} repeaters: choose 1 to {MAX_REPEATERS}")
        self.add_classical_network(source="alice", **fiber)
        names = [f"r{number}" for number in range(1, count + 1)]
        for number, name in enumerate(names, 1):
            self.add_host(name, f"10.0.0.{10 + number}")
        switches = self.add_quantum_switches(count + 1)
        for switch, (left, right) in zip(switches, pairwise(["alice", *names, "bob"]), strict=True):
            self.join(left, switch, 1)
            self.join(right, switch, 1)
            if stations:
                self.add_station(f"m{switch[1:]}", switch, count)

    def add_station(self, name: str, switch: str, repeaters: int) -> None:
        device = self._devices.get(name, STATION)
        self.add_host(name, f"10.0.0.{10 + repeaters + int(name[1:])}", device=device)
        self.join(name, switch, 2)


topos = {"repeaters": RepeatersTopo}
