"""How long it takes to act on qubits that a node keeps: it hears of it when that is over.

All qubits of a block are acted on at once. What happens to them meanwhile is in the errors of the
operation; whatever else is in the node's memory decoheres by the clock, and so do other nodes'
qubits. To light nothing of this applies: modulators and detectors are as fast as it comes.
"""

from collections.abc import Sequence

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from wire.dispatcher_pb2 import Feedback
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
    """Return what a node is told of an operation when it is over."""
    if layer.devices.of(node).gates.take_time:
        await layer.clock.wait_until(feedback.time_ns)
    return feedback
