"""The two bits of each swap, and those of several in a row: pure functions on arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.replies import Symbols

MAX_OPERATOR = 3  # a Pauli operator is two bits: X, Z


class Bits(NamedTuple):
    """By which operators the first pairs of a chain are corrected; shape (k,) each.

    Pair i is made of the i-th pairs of all links: there are as many as the poorest link has.
    """

    seen: NDArray[np.bool_]  # whether every analyser on the path has reported
    operators: Symbols  # 0 where not

    @classmethod
    def of_outcomes(cls, outcomes: Symbols, distinguishable_states: frozenset[int]) -> "Bits":
        """Return what a Bell measurement tells: the state's number is the operator.

        States that the analyser does not tell from others count as not seen.
        """
        seen = np.isin(outcomes, list(distinguishable_states))
        return cls(seen, np.where(seen, outcomes, 0).astype(np.uint8))

    @classmethod
    def none(cls, size: int) -> "Bits":
        """Return those of `size` pairs before any swap."""
        return cls(np.ones(size, dtype=bool), np.zeros(size, dtype=np.uint8))

    @property
    def size(self) -> int:
        return self.seen.size

    def first(self, most: int) -> "Bits":
        return Bits(self.seen[:most], self.operators[:most])

    def joined(self, other: "Bits") -> "Bits":
        """Return those of two chains of which one continues the other: operators multiply."""
        size = min(self.size, other.size)
        one, two = self.first(size), other.first(size)
        seen = one.seen & two.seen
        return Bits(seen, np.where(seen, one.operators ^ two.operators, 0).astype(np.uint8))


class Swapped(NamedTuple):
    """A repeater's report of a block when it has swapped."""

    place: int  # in the chain
    waited_us: int  # by each half that it has joined, from its memory's taking it; on average
    bits: Bits
