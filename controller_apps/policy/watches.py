"""Light that is to be watched while nobody uses it, as the policy names it."""

from dataclasses import dataclass

MAX_WATCHES = 256
BLOCK_PAIRS = 1024
BLOCKS_PER_S = 10  # at least: a seal gives its light back between two blocks
# The host's own ranges (hosts.middleware.services.sealing) and no more than a watch may take.
RANGES: dict[str, tuple[float, float]] = {
    "every_s": (0.2, 86_400.0),
    "pairs": (1, 10_000_000),
    "rate_hz": (100, 1_000_000_000),
    "whole_error": (1e-6, 0.2),
    "fraction": (0.001, 1.0),
    "false_alarm": (1e-15, 0.1),
    "missed": (1e-15, 0.1),
}


@dataclass(frozen=True)
class Watch:
    """Two hosts whose way is watched while it is idle; the first makes the pairs."""

    between: tuple[str, str]
    over: frozenset[str] = frozenset()  # switches whose fibre is to be on the way; empty: any way
    every_s: float = 10.0  # of the network, from the end of one seal to the beginning of the next
    pairs: int = 2000  # to compare
    rate_hz: int = 100_000
    whole_error: float = 0.01  # part of the pairs that differ though nobody is there, at most
    fraction: float = 0.25  # of the photons that an intruder measures, who is to be found
    false_alarm: float = 1e-6  # of a test, at most
    missed: float = 0.01  # that a test takes such an intruder for nobody, at most

    def __str__(self) -> str:
        way = f" over {'-'.join(sorted(self.over))}" if self.over else ""
        return f"{self.between[0]} to {self.between[1]}{way}"

    @property
    def block_pairs(self) -> int:
        """How many pairs a block has."""
        return max(1, min(BLOCK_PAIRS, self.pairs, self.rate_hz // BLOCKS_PER_S))
