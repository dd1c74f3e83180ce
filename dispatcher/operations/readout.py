"""Errors of making qubits and reading them: classical flips of what is prepared, or told."""

import numpy as np

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from wire.outcomes import NO_CLICK


def misread(
    layer: PhysicalLayer, block: Block, found: Bytes, what: str, bits: int = 1
) -> tuple[Bytes, int]:
    """Return what a node tells, of so many bits each, and how many outcomes of it are wrong."""
    error = layer.devices.of(block.node).gates.readout_error
    if not error:
        return found, 0
    place = block.draws_for(f"readout, {what} {block.resends}")
    random = PhotonRandom(layer.draws, block.name, place, found.size)
    flips = np.zeros(found.size, np.uint8)
    for bit in range(bits):
        flips[random.events(f"bit {bit}", error)] ^= np.uint8(1 << bit)
    flips[found == NO_CLICK] = 0
    return found ^ flips, int(np.count_nonzero(flips))


def misprepared(layer: PhysicalLayer, block: Block) -> int:
    """Let some qubits of a new block in |0> be in |1>; return how many."""
    error = layer.devices.of(block.node).gates.initialization_error
    if not error:
        return 0
    place = block.draws_for("initialization")
    random = PhotonRandom(layer.draws, block.name, place, block.register.size)
    flips = np.zeros(block.register.size, np.uint8)
    flips[random.events("error", error)] = 1
    layer.sabot.explain(block.register, f"initialization at {block.node}", flips)
    layer.sabot.pauli(block.register, flips)
    return int(np.count_nonzero(flips))
