"""Blocks of stored photons of which some are taken: what the ends of a service do with them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.qnic import BlockName, Positions, Qnic, Symbols

LOST = 3  # instead of an outcome, where there was none; it fits into two bits

# Numbers of blocks that are beside those of light, each for one use at a time.
RESERVED = 0xFFFF_FF00
TARGETS, SAMPLE, PAIRS, ASKED = range(RESERVED, RESERVED + 4)
THIRDS = tuple(range(RESERVED + 4, RESERVED + 7))


def reserved(name: BlockName, number: int) -> BlockName:
    """Return the block of this number beside another."""
    return replace(name, number=number)


async def keep(qnic: Qnic, name: BlockName, chosen: NDArray[np.bool_]) -> int:
    """Let go of all photons of a block but these; return how many there are now."""
    await take(qnic, name, {name: np.flatnonzero(chosen)})
    return int(np.count_nonzero(chosen))


async def keep_of_all(qnic: Qnic, name: BlockName, chosen: NDArray[np.bool_]) -> int:
    """Do what `keep` does where each photon of the block is chosen or not; all: nothing."""
    if chosen.size and chosen.all():
        return chosen.size
    return await keep(qnic, name, chosen)


async def take(qnic: Qnic, into: BlockName, picks: dict[BlockName, Positions]) -> None:
    """Gather photons and let go of the rest, also where there are none to gather."""
    if any(positions.size for positions in picks.values()):
        await qnic.gather(into, picks)
    else:
        for name in picks:
            await qnic.discard_block(name.session, name.number)


async def measure_some(
    qnic: Qnic, name: BlockName, number: int, positions: Positions, bases: Symbols
) -> Symbols:
    """Measure photons of a block, by way of another; return the outcomes, 3 where there is none.

    Their places in the block stay, empty.
    """
    part = reserved(name, number)
    await qnic.gather(part, {name: positions}, keep_rest=True)
    outcomes = await qnic.measure(part, bases)
    return np.where(outcomes <= 1, outcomes, LOST).astype(np.uint8)


async def store(qnic: Qnic, name: BlockName) -> NDArray[np.bool_]:
    """Put a block into memory again; return which of its photons are there."""
    return (await qnic.store(name)).arrived
