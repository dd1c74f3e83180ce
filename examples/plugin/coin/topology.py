"""A topology: alice, bob and the source at a corridor of quantum switches.

    alice --- q1 === q2 === … === bob
                      |
                   charlie (at the first)

qmn run coin --topology corridor,switches=5
"""

from itertools import pairwise
from typing import Any

from qmn.topology import OpticalSwitch, QuantumHost, QuantumTopo


class CorridorTopo(QuantumTopo):
    """Quantum switches in a line; alice counts the steps of her hardware."""

    def build(self, switches: int = 2, **fiber: Any) -> None:
        names = [self.addSwitch(f"q{place}", cls=OpticalSwitch) for place in range(1, switches + 1)]
        self.addHost("alice", cls=QuantumHost, qnic="counting")
        self.addHost("bob", cls=QuantumHost)
        self.addHost("charlie", cls=QuantumHost, source=True)
        self.addFibers("alice", names[0], **fiber)
        self.addFibers("charlie", names[0], 2, **fiber)
        self.addFibers("bob", names[-1], 2, **fiber)
        for one, other in pairwise(names):
            self.addFibers(one, other, 2, **fiber)
