"""The heralds of a memory that takes in light: for which photons it says that they have come.

    photon             came   came     lost   lost
    memory says        yes    no       yes    no
    place              full   empty    empty  empty

A photon that is not heralded is not kept; a place that is heralded by mistake holds nothing, which
nobody notices until it is read: it then has no outcome. Qubits that a host keeps already, or has
made, are not light and need no herald.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dispatcher.layer import extra_pairs
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.registers import Mask
from dispatcher.sabot.simulation import Simulation
from wire.parameters.physics import Memory


def meet(sabot: Simulation, draws: Draws, block: Block, memory: Memory) -> str:
    """Herald light that enters a memory; return what the event log says of errors."""
    if block.kept or not block.fibers_passed or memory.heralds_perfectly:
        return ""
    place = block.draws_for(f"herald of {block.node}, {block.fibers_passed}")
    random = PhotonRandom(draws, block.name, place, block.register.size)
    came = extra_pairs.held(block)
    missed = came & random.happens("missed", 1 - memory.herald_efficiency)
    block.false_heralds = ~came & random.happens("false", memory.false_herald)
    extra_pairs.darken(sabot, block, missed)
    sabot.lose(block.register, missed)
    counts = {"missed": missed, "false": block.false_heralds}
    return " ".join(f"{name}-heralds={mask.sum()}" for name, mask in counts.items() if mask.any())


def heralded(block: Block) -> Mask:
    """Return which photons of a block its memory says are there, shape (k,)."""
    held = extra_pairs.held(block)
    return held if block.false_heralds is None else held | block.false_heralds


def drop(block: Block, old: Mask) -> None:
    """Let no place be heralded any more that is given up, shape (k,)."""
    if block.false_heralds is not None:
        block.false_heralds = block.false_heralds & ~old


def gather(picked: Sequence[tuple[Block, NDArray[np.uint32]]]) -> Mask | None:
    """Return which places are heralded by mistake at these positions of blocks; None: none."""
    if all(block.false_heralds is None for block, _positions in picked):
        return None
    return np.concatenate(
        [
            np.zeros(positions.size, bool)
            if block.false_heralds is None
            else block.false_heralds[positions]
            for block, positions in picked
        ]
    )
