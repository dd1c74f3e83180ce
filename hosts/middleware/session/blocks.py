"""Blocks of stored photons of which some are taken: what the ends of a service do with them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Positions, Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.protocol import Steps, do

Mask = NDArray[np.bool_]  # shape (k,)

LOST = 3  # instead of an outcome, where there was none; it fits into two bits

# Numbers of blocks that are beside those of light, each for one use at a time.
RESERVED = 0xFFFF_FF00
TARGETS, SAMPLE, PAIRS, ASKED = range(RESERVED, RESERVED + 4)
THIRDS = tuple(range(RESERVED + 4, RESERVED + 7))
ROW, ROWS = 16, 16  # numbers for what is beside one block; blocks that are under way at once


def reserved(name: BlockName, number: int) -> BlockName:
    """Return the block of this number beside another: two blocks that follow have two."""
    return replace(name, number=number + ROW * (name.number % ROWS))


def keep(name: BlockName, chosen: Mask) -> Steps[int]:
    """Discard all photons of a block but these; return how many there are now."""
    yield from take(name, {name: np.flatnonzero(chosen)})
    return int(np.count_nonzero(chosen))


def keep_of_all(name: BlockName, chosen: Mask) -> Steps[int]:
    """Do what `keep` does where each photon of the block is chosen or not; all: nothing."""
    if chosen.size and chosen.all():
        return chosen.size
    return (yield from keep(name, chosen))


def take(into: BlockName, picks: dict[BlockName, Positions]) -> Steps[None]:
    """Gather photons and discard the rest, also where there are none to gather."""
    if any(positions.size for positions in picks.values()):
        yield from do(Qnic.gather, into, picks)
    else:
        for name in picks:
            yield from do(Qnic.discard_block, name.session, name.number)


def measure_some(
    name: BlockName, number: int, positions: Positions, bases: Symbols
) -> Steps[Symbols]:
    """Measure photons of a block, by way of another; return the outcomes, 3 where there is none.

    Their places in the block stay, empty.
    """
    return (yield from measure_some_at(name, number, positions, bases))[0]


def measure_some_at(
    name: BlockName, number: int, positions: Positions, bases: Symbols
) -> Steps[tuple[Symbols, int]]:
    """Do what `measure_some` does; also return when (ns) that was."""
    part = reserved(name, number)
    yield from do(Qnic.gather, part, {name: positions}, keep_rest=True)
    measured = yield from do(Qnic.outcomes, part, bases)
    return np.where(measured.outcomes <= 1, measured.outcomes, LOST).astype(
        np.uint8
    ), measured.time_ns


def store(name: BlockName) -> Steps[Mask]:
    """Put a block into memory again; return which of its photons are there."""
    stored = yield from do(Qnic.store, name)
    return stored.arrived


def stored_since(name: BlockName) -> Steps[int]:
    """Put a block into memory again; return the mean time (ns) from which it waits there."""
    stored = yield from do(Qnic.store, name)
    return stored.since_ns


def correct_rotation(name: BlockName, arrived: NDArray[np.bool_], rotation: int) -> Steps[Mask]:
    """Undo what the light paths are known to do; return which photons are there then."""
    if not arrived.any() or not rotation:
        return arrived
    yield from do(Qnic.apply, name, np.full(arrived.size, rotation, dtype=np.uint8))
    return (yield from store(name))
