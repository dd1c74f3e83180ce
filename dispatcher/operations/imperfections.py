"""Imperfections of devices at work: the time that they take, and flips of what is made or read.

All qubits of a block are acted on at once. What happens to them meanwhile is in the errors of the
operation; whatever else is in the node's memory decoheres by the clock, and so do other nodes'
qubits. To light nothing of this applies: modulators and detectors are as fast as it comes.
"""

from collections.abc import Sequence

import numpy as np

from dispatcher.fiber.noise import Effect
from dispatcher.layer import part_noise
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from wire.dispatcher_pb2 import Feedback
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Gates


def of_gates(gates: Gates, one_qubit: int, two_qubit: int) -> float:
    """Return how many seconds so many gates one after the other take."""
    return one_qubit * gates.one_qubit_s + two_qubit * gates.two_qubit_s


def of_bell_measurement(gates: Gates) -> float:
    """Return how many seconds a CX, an H, and both readings at a time take."""
    return of_gates(gates, 1, 1) + gates.readout_s


def lasts(feedback: Feedback, seconds: float, blocks: Sequence[Block] = ()) -> Feedback:
    """Let an operation be over so much later; blocks that are left of it wait from then on."""
    if seconds:
        feedback.time_ns += round(seconds * 1e9)
        for block in blocks:
            block.start_ns, block.interval_ns, block.came_ns = feedback.time_ns, 0.0, None
    return feedback


async def over(layer: PhysicalLayer, node: str, feedback: Feedback) -> Feedback:
    if layer.devices.of(node).gates.take_time:
        await layer.clock.wait_until(feedback.time_ns)
    return feedback


def noise_of_detectors(layer: PhysicalLayer, block: Block, place: str) -> Effect | None:
    """Return the effect of a user's own noise model on what detectors report, if there is one."""
    model = layer.devices.noise(block.node, "detectors")
    if model is None:
        return None
    now_ns = layer.clock.now_ns()
    return part_noise.effect_of(model, layer.draws, block, "detectors", place, now_ns)


def misread(
    layer: PhysicalLayer, block: Block, found: Bytes, what: str, bits: int = 1
) -> tuple[Bytes, int]:
    """Return what a node tells, of so many bits each, and how many outcomes of it are wrong.

    Two bits are of a Bell measurement by gates; one is of a qubit that is kept, or of light.
    """
    device = layer.devices.of(block.node)
    by_gates = block.kept or bits > 1
    error = device.gates.readout_error if by_gates else device.detectors.readout_error
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
