"""BB84 by prepared states: pulses in Z and X that bob measures in bases drawn at random."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory
from dispatcher.sabot.backend import Bytes
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.link import TESTED
from evidence.curves.superdense import blocks
from wire.outcomes import NO_CLICK

Counts = NDArray[np.int64]
Forward = Callable[[int], Awaitable[None]]  # takes a block from alice's fibre to bob's
Listen = Callable[[int, "Block"], Awaitable[None]]


@dataclass(frozen=True)
class Block:
    """The bits sent and seen of a block of pulses: arrays of shape (pulses,)."""

    states: Bytes
    bases: Bytes  # of bob
    levels: Bytes  # of intensity
    bits: Bytes  # of bob, NO_CLICK where no detector clicked

    @property
    def sifted(self) -> NDArray[np.bool_]:
        same: NDArray[np.bool_] = (self.bits != NO_CLICK) & (self.bases == self.states >> 1)
        return same


class Exchange:
    """Counts of pulses; arrays end with the level of intensity."""

    def __init__(self, levels: int) -> None:
        self.sent, self.seen = np.zeros(levels, np.int64), np.zeros(levels, np.int64)
        self.counts = np.zeros((2, 2, levels), np.int64)  # sifted: basis, right or wrong, level
        self.ones = 0

    def add(self, block: Block) -> None:
        levels, same, clicked = len(self.sent), block.sifted, block.bits != NO_CLICK
        wrong = (block.bits ^ block.states)[same] & np.uint8(1)
        self.sent += np.bincount(block.levels, minlength=levels)
        self.seen += np.bincount(block.levels[clicked], minlength=levels)
        self.ones += int((block.bits == 1).sum())
        np.add.at(self.counts, (block.bases[same], wrong, block.levels[same]), 1)

    def gain(self, level: int = 0) -> Estimate:
        return proportion(int(self.seen[level]), int(self.sent[level]))

    @property
    def qber(self) -> Estimate:
        """The share of wrong bits among those of the first level."""
        signal = self.counts[:, :, 0].sum(axis=0)
        return proportion(int(signal[1]), int(signal.sum()))


async def exchange(
    laboratory: Laboratory,
    pulses: int,
    random: np.random.Generator,
    shares: Sequence[float] = (),
    path: tuple[str, str] = TESTED,
    forward: Forward | None = None,
    listen: Listen | None = None,
) -> Exchange:
    """Send pulses from alice, by `path` to bob, and count them.

    Pulses have levels with these shares, or one. `forward` carries each block on at a host between
    the two; `listen` gets the outcome.
    """
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    found = Exchange(len(shares) or 1)
    for number, size in enumerate(blocks(pulses)):
        states, bases = random.integers(0, (4, 2), (size, 2), dtype=np.uint8).T.copy()
        levels = np.zeros(size, np.uint8)
        if shares:
            levels = random.choice(len(shares), size, p=shares).astype(np.uint8)
        await alice.prepare(states, number, levels if shares else None)
        await alice.send({(number, 0): path[0]})
        if forward is not None:
            await forward(number)
        bits = np.full(size, NO_CLICK, np.uint8)
        if await bob.receive((number, 0), path[1]) is not None:
            bits = await bob.measure((number, 0), bases=bases)
        block = Block(states, bases, levels, bits)
        found.add(block)
        if listen is not None:
            await listen(number, block)
    return found
