"""The fidelity of states to GHZ, |0...0> + |1...1>, from measurements of single qubits.

The state is the only one that all 2^N of its stabilisers leave alone, and its fidelity the mean of
their expectations (Flammia and Liu, Phys. Rev. Lett. 106, 230501, 2011). Half of them are Z on an
even number of hosts: their mean is how likely all outcomes in Z are equal. The others are X on
all hosts, times Z on an even number of them: Y there, X at the others, with the sign
(-1)^(number / 2). Above 1/2 the state is entangled among all (Guehne and Toth 2009).
"""

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hosts.middleware.session.estimation import share_variance
from wire.outcomes import BASES

Z, X, Y = (BASES.index(name) for name in "ZXY")

Table = NDArray[np.uint8]  # shape (hosts, states)


def chosen_bases(draws: np.random.Generator, hosts: int, states: int) -> Table:
    """Return in which basis each host measures each state: a stabiliser at random."""
    flipped = draws.integers(0, 2, (hosts, states), dtype=np.uint8)
    flipped[-1] = flipped[:-1].sum(axis=0) & 1  # an even number of Y
    coherent = draws.integers(0, 2, states, dtype=np.uint8).astype(bool)
    bases: Table = np.where(coherent, np.where(flipped, Y, X), Z).astype(np.uint8)
    return bases


@dataclass
class Tally:
    equal: int = 0  # outcomes in Z at all hosts
    in_z: int = 0  # states
    right: int = 0  # parities of the others
    in_x: int = 0

    def add(self, bases: Table, outcomes: Table) -> None:
        there = (outcomes <= 1).all(axis=0)
        in_z = bases[0] == Z
        measured = outcomes[:, there & in_z]
        self.in_z += measured.shape[1]
        self.equal += int(np.count_nonzero((measured == measured[:1]).all(axis=0)))
        parity = outcomes[:, there & ~in_z].sum(axis=0) & 1
        sign = (bases[:, there & ~in_z] == Y).sum(axis=0) // 2 & 1
        self.in_x += parity.size
        self.right += int(np.count_nonzero(parity == sign))

    @property
    def states(self) -> int:
        return self.in_z + self.in_x

    def summary(self) -> dict[str, Any]:
        if not self.in_z or not self.in_x:
            return dict.fromkeys(("fidelity", "fidelity_error", "equal_in_z", "coherence"))
        equal, right = self.equal / self.in_z, self.right / self.in_x
        spread = share_variance(self.equal, self.in_z) / 4 + share_variance(self.right, self.in_x)
        return {
            "fidelity": (equal + 2 * right - 1) / 2,
            "fidelity_error": sqrt(spread),
            "equal_in_z": equal,
            "coherence": 2 * right - 1,
        }
