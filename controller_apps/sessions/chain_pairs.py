"""The pairs of one block between two ends of a chain of switches, as the controller keeps account.

    stored at both ends --> round of purification --the same bits--> … --> swapped, or of the hosts

An end is a memory, or a host, whose blocks have the numbers 1, 2, 3, …. Pair i is made of the i-th
pulses that are named at both.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from controller_apps.policy.schedules import PROTOCOLS
from wire.analyser_frames import PHOTONS, THIRD, AnalyserFrame, End
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.switch import HALVES

THIRDS, PAULIS = 3, 4
Symbols = NDArray[np.uint8]


@dataclass(frozen=True)
class Half:
    port: int  # of the memory; of a host 1 for the opener, 2 for the acceptor
    number: int  # of the block there
    pulses: int  # for which the block has places now
    at: NDArray[np.intp]  # the places of the pairs, in order

    def frame(self, end: End, symbols: Symbols | int, method: int = 0) -> AnalyserFrame:
        """Return what tells this end a symbol of each pair; other pulses are discarded."""
        outcomes = np.full(self.pulses, NO_COINCIDENCE, np.uint8)
        outcomes[self.at] = symbols
        return AnalyserFrame(
            self.port, self.number, end, self.pulses, 0, outcomes.tobytes(), method=method
        )

    def only(self, chosen: NDArray[np.bool_]) -> Self:
        return replace(self, at=self.at[: chosen.size][chosen])


@dataclass
class Pairs:
    """All of one block between two ends."""

    left: Half
    right: Half
    operators: Symbols  # that make Phi+ of them, at the right end; shape (k,)
    seen: NDArray[np.bool_]  # by all analysers between the ends
    rounds: int = 0  # of purification that are to come
    bits: dict[bool, Symbols] = field(default_factory=dict)  # of a round, of the right end or not

    @classmethod
    def of_link(cls, left: Half, right: Half, operators: Symbols, rounds: int) -> Self:
        """Return those of a link, by what its station reports; it may have missed a state."""
        seen = operators != NO_COINCIDENCE
        return cls(left, right, np.where(seen, operators, 0).astype(np.uint8), seen, rounds)

    @property
    def size(self) -> int:
        return int(self.seen.size)

    def joined(self, right: "Pairs", outcomes: Symbols, rounds: int) -> "Pairs":
        size = min(self.size, right.size, outcomes.size)
        every, outcomes = np.ones(size, bool), outcomes[:size]
        seen = self.seen[:size] & right.seen[:size] & (outcomes != NO_COINCIDENCE)
        operators = np.where(seen, self.operators[:size] ^ right.operators[:size] ^ outcomes, 0)
        left, far_end = self.left.only(every), right.right.only(every)
        return Pairs(left, far_end, operators.astype(np.uint8), seen, rounds)

    def choose(self) -> None:
        """Go on with the pairs alone that all analysers have seen."""
        self.left, self.right = self.left.only(self.seen), self.right.only(self.seen)
        self.operators, self.seen = self.operators[self.seen], self.seen[self.seen]

    def begin_round(self, protocol: str, seed: tuple[int, ...]) -> list[AnalyserFrame]:
        """Return what has both ends do a round; nothing if there are too few pairs, and none then.

        BBPSSW twirls: the same operators and thirds of a turn at both ends, by the seed.
        """
        self.choose()
        self.bits.clear()
        if self.size < PHOTONS:
            self.seen = np.zeros(self.size, bool)
            self.choose()
            self.rounds = 0
            return []
        number, twirl = PROTOCOLS[protocol], np.zeros(self.size, np.uint8)
        if protocol == "bbpssw":
            draws = np.random.default_rng(seed)
            twirl = draws.integers(0, PAULIS, self.size, np.uint8)
            twirl += THIRD * draws.integers(0, THIRDS, self.size, np.uint8)
        return [
            self.left.frame(End.PURIFY, twirl, 2 * number),
            self.right.frame(End.PURIFY, twirl ^ self.operators, 2 * number + 1),
        ]

    def measured(self, is_right: bool, bits: bytes) -> bool:
        """Take what an end has measured in a round; return whether that is over."""
        if len(bits) != self.size // PHOTONS:
            return False
        self.bits[is_right] = np.frombuffer(bits, np.uint8)
        if len(self.bits) < HALVES:
            return False
        agreed = (self.bits[False] == self.bits[True]) & (self.bits[False] <= 1)
        at = np.flatnonzero(agreed)
        left, right = (replace(half, pulses=agreed.size, at=at) for half in (self.left, self.right))
        self.left, self.right, self.rounds = left, right, self.rounds - 1
        self.operators, self.seen = np.zeros(at.size, np.uint8), np.ones(at.size, bool)
        return True

    def last(self, rounds: int) -> list[AnalyserFrame]:
        """Return what tells both hosts their pairs, and rounds; the acceptor corrects its own."""
        self.choose()
        frames = self.left.frame(End.PURIFY, 0), self.right.frame(End.PURIFY, self.operators)
        return [replace(frame, waited_us=rounds) for frame in frames]
