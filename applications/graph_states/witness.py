"""The fidelity of graph states, from measurements of single qubits.

A graph state is the only one that its generators K = X at a host, Z at its neighbours, leave alone,
one for each of N hosts, and all 2^N products of them. Its fidelity is the mean of their
expectations (Flammia and Liu, Phys. Rev. Lett. 106, 230501, 2011), which `Stabilisers` draws. Of
hosts of one colour, no two of them neighbours, all generators are measured at once: X there, Z at
the others. With the probability P_c that all of a colour are +1, the fidelity is at least
sum of P_c - (colours - 1), since a state that has failed no test is the graph state: for two
colours the witness 3 - 2 (P_1 + P_2) of Toth and Guehne (Phys. Rev. Lett. 94, 060501, 2005).
Above 1/2 the state is entangled among all hosts, if its graph is connected.
"""

from dataclasses import dataclass, field
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.ghz.line import Table
from applications.ghz.witness import X, Y, Z
from applications.graph_states.graph import Graph
from hosts.middleware.session.estimation import share_variance


@dataclass
class Stabilisers:
    """The fidelity, by products of generators drawn of all but the empty one."""

    graph: Graph
    states: int = 0
    right: int = 0  # states whose parity is that of the graph state

    def bases(self, draws: np.random.Generator, states: int) -> Table:
        """Return in which basis each host measures each state: Z also where it does not matter."""
        hosts = self.graph.hosts
        drawn = draws.integers(1, 1 << hosts, states)
        chosen = (drawn >> np.arange(hosts)[:, None] & 1).astype(np.uint8)
        return np.where(chosen, np.where(self._neighbours(chosen), Y, X), Z).astype(np.uint8)

    def _neighbours(self, chosen: Table) -> Table:
        """Return 1 for hosts with an odd number of neighbours that are chosen."""
        return (self.graph.adjacency @ chosen & 1).astype(np.uint8)

    def add(self, bases: Table, outcomes: Table) -> None:
        """Count states: bases and outcomes of all hosts, above 1 where there was none.

        K of hosts that are chosen make X or Y there and Z at others with an odd number of them as
        neighbours. Of each edge between two that are chosen comes a sign, and of each two Y.
        """
        there = (outcomes <= 1).all(axis=0)
        chosen, measured = (bases[:, there] != Z).astype(np.uint8), outcomes[:, there]
        used = chosen | self._neighbours(chosen)
        signs = sum(chosen[a] & chosen[b] for a, b in self.graph.edges)
        signs = signs + (bases[:, there] == Y).sum(axis=0) // 2
        self.states += measured.shape[1]
        self.right += int(np.count_nonzero((measured & used).sum(axis=0) & 1 == signs & 1))

    def summary(self) -> dict[str, Any]:
        """Return the fidelity and its standard error; None where nothing is known."""
        if not self.states:
            return dict.fromkeys(("fidelity", "fidelity_error"))
        mean, empty = 2 * self.right / self.states - 1, 0.5**self.graph.hosts
        return {
            "fidelity": empty + (1 - empty) * mean,
            "fidelity_error": (1 - empty) * 2 * sqrt(share_variance(self.right, self.states)),
        }


@dataclass
class Colours:
    """A bound of the fidelity, by as many settings as the graph has colours."""

    graph: Graph
    seen: NDArray[np.int64] = field(init=False)  # states, of each colour
    passed: NDArray[np.int64] = field(init=False)  # those of which all generators are +1

    def __post_init__(self) -> None:
        self._colours = np.array(self.graph.colours)
        self.seen, self.passed = np.zeros((2, 1 + max(self._colours)), np.int64)

    @property
    def states(self) -> int:
        return int(self.seen.sum())

    def bases(self, draws: np.random.Generator, states: int) -> Table:
        drawn = draws.integers(0, self.seen.size, states)
        return np.where(self._colours[:, None] == drawn, X, Z).astype(np.uint8)

    def add(self, bases: Table, outcomes: Table) -> None:
        there = (outcomes <= 1).all(axis=0)
        in_x, measured = bases[:, there] == X, outcomes[:, there]
        wrong = (measured + self.graph.adjacency @ measured) & 1 & in_x
        colours = self._colours[in_x.argmax(axis=0)]
        self.seen += np.bincount(colours, minlength=self.seen.size)
        self.passed += np.bincount(colours[~wrong.any(axis=0)], minlength=self.seen.size)

    def summary(self) -> dict[str, Any]:
        """Return the bound and its standard error; None where nothing is known."""
        if not self.seen.all():
            return dict.fromkeys(("fidelity_at_least", "fidelity_error", "passed"))
        passed = self.passed / self.seen
        return {
            "fidelity_at_least": float(passed.sum()) - (passed.size - 1),
            "fidelity_error": sqrt(share_variance(self.passed, self.seen).sum()),
            "passed": passed.tolist(),
        }
