"""The cut-off of memories: qubits that are kept for longer are dropped.

A qubit is as old as it is long ago that it came to the node: light with its arrival, one that has
emitted with its emission. Operations do not make it younger. To be measured or joined with others
at the very end of its time is early enough.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dispatcher.layer import extra_pairs, herald
from dispatcher.layer.ownership import Block
from dispatcher.refusal import invalid
from dispatcher.sabot.simulation import Simulation
from wire.dispatcher_pb2 import AttemptRequest, StoreRequest

NEVER = float("inf")


def requested(request: StoreRequest | AttemptRequest) -> float | None:
    """Return the cut-off (s) that a host requests, None for its memory's own."""
    if not request.HasField("cutoff_s"):
        return None
    if not request.cutoff_s > 0:  # or not a number
        raise invalid(f"cut-off of {request.cutoff_s} s; give more than 0, or infinity for none")
    return request.cutoff_s


def drop(sabot: Simulation, block: Block, until_ns: int, step_ns: float = 0.0) -> int:
    """Drop the qubits of a block that are too old when they are wanted; return how many.

    Qubit k is wanted k steps later than the first.
    """
    if block.cutoff_s == NEVER:
        return 0
    wanted_ns = until_ns + (np.arange(block.register.size) * step_ns).astype(np.int64)
    old = wanted_ns - born_ns(block) > block.cutoff_s * 1e9
    if not old.any():
        return 0
    extra_pairs.darken(sabot, block, old)
    herald.drop(block, old)
    return sabot.lose(block.register, old)


def remember(block: Block) -> None:
    """Keep in mind when each qubit came, of a block whose times are about to change."""
    if block.cutoff_s != NEVER:
        block.born_ns = born_ns(block)


def forget(block: Block) -> None:
    """Let a block be light again that has left the node."""
    block.cutoff_s, block.born_ns = NEVER, None


def born_ns(block: Block) -> NDArray[np.int64]:
    """Return when each qubit of a block came, shape (k,)."""
    return came_ns(block) if block.born_ns is None else block.born_ns


def came_ns(block: Block) -> NDArray[np.int64]:
    """Return since when each qubit of a block waits, shape (k,)."""
    if block.came_ns is not None:
        return block.came_ns
    steps_ns = np.arange(block.register.size) * block.interval_ns
    return block.start_ns + steps_ns.astype(np.int64)


def gather(picked: Sequence[tuple[Block, NDArray[np.uint32]]]) -> NDArray[np.int64] | None:
    """Return when qubits at these positions of blocks came; None where none can be too old."""
    if all(block.cutoff_s == NEVER and block.born_ns is None for block, _positions in picked):
        return None
    return np.concatenate([born_ns(block)[positions] for block, positions in picked])
