"""Sensing: qubits of a host take the phase of what they are exposed to (wire.parameters.Sensor).

RZ(phase) up to a phase of the whole: |0> + |1> becomes |0> + exp(i phase) |1>, and of a GHZ state
whose qubits take phases at several hosts |0...0> + exp(i sum of phases) |1...1>. State vectors hold
it exactly; a phase of quarter turns stays with the stabilisers.
"""

from dispatcher.layer import drift, further
from dispatcher.layer.layer import PhysicalLayer, block_name
from dispatcher.sabot.capacity import GateStep
from wire.dispatcher_pb2 import Feedback, SenseRequest


def sense(layer: PhysicalLayer, node: str, request: SenseRequest) -> Feedback:
    """Let every photon of a block take the phase of the node's sensor."""
    block = layer.ownership.require(block_name(request.block), node)
    phase_rad = layer.devices.of(node).sensor.phase_rad
    layer.sabot.require_capacity(block.register, [GateStep("RZ", angle_rad=phase_rad)])
    layer.take_up(block)
    if not block.fibers_passed:  # it is no light, but a qubit that was made here
        block.kept = True
    drift.twirl_turn(block, layer.sabot, layer.draws)
    layer.sabot.gate("RZ", block.register, angle_rad=phase_rad)
    further.gate(layer.sabot, block, "RZ", phase_rad)
    layer.record(node, "sense", block, detail=f"phase {phase_rad:g} rad")
    return layer.feedback(block)
