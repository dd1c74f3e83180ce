"""Looks at states, and the words of hosts about themselves: nothing happens to a qubit.

Only a simulation can look so. A state is pure here, whatever noise there was: that has been drawn.
A qubit that is entangled with others is in a mixed state by itself.

Sensing: qubits of a host take the phase of what they are exposed to (wire.parameters.Sensor).

RZ(phase) up to a phase of the whole: |0> + |1> becomes |0> + exp(i phase) |1>, and of a GHZ state
whose qubits take phases at several hosts |0...0> + exp(i sum of phases) |1...1>. State vectors hold
it exactly; a phase of quarter turns stays with the stabilisers.
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.layer import drift, extra_pairs
from dispatcher.layer.layer import PhysicalLayer, block_name
from dispatcher.operations import weak_light
from dispatcher.refusal import exhausted, invalid, precondition
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.dense import Dense
from wire.dispatcher_pb2 import Feedback, LookReply, LookRequest, SenseRequest, TellRequest


def sense(layer: PhysicalLayer, node: str, request: SenseRequest) -> Feedback:
    block = weak_light.require(layer, block_name(request.block), node)
    phase_rad = layer.devices.of(node).sensor.phase_rad
    layer.sabot.require_capacity(block.register, [GateStep("RZ", angle_rad=phase_rad)])
    layer.take_up(block)
    if not block.fibers_passed:  # it is no light, but a qubit that was made here
        block.kept = True
    drift.twirl_turn(block, layer.sabot, layer.draws)
    layer.sabot.gate("RZ", block.register, angle_rad=phase_rad)
    extra_pairs.gate(layer.sabot, block, "RZ", phase_rad)
    layer.record(node, "sense", block, detail=f"phase {phase_rad:g} rad")
    return layer.feedback(block)


MOST_QUBITS = 8  # of a state in a reply

Matrix = NDArray[np.complex128]
MOST = 4000  # characters


def look(layer: PhysicalLayer, node: str, request: LookRequest) -> LookReply:
    """Return the density matrix of a qubit, perhaps with all that it is entangled with."""
    block = weak_light.require(layer, block_name(request.block), node)
    if block.register.size != 1 or not block.register.remaining:
        raise invalid(f"{block.name} is not one qubit; gather one, and look at that")
    if layer.memories.holds(block):
        layer.memories.look_in(block)
    drift.twirl(block, layer.sabot, layer.draws)
    if not block.register.shares:
        raise precondition("states are in a Sabot server: start the network without --sabot")
    (share,) = block.register.shares
    component = share.component
    (places,) = np.nonzero(np.arange(block.register.size)[share.positions] == 0)
    state = component.state.take(places)
    if state.qubits > MOST_QUBITS:
        raise exhausted(f"{state.qubits} qubits are entangled here; a look is at {MOST_QUBITS}")
    vector = (state if isinstance(state, Dense) else Dense.from_stabilizers(state)).amplitudes[0]
    matrix = density(vector, component.shares.index(share), request.entangled)
    layer.record(node, "look", block, detail="which real hardware could not reveal")
    return LookReply(real=matrix.real.ravel(), imaginary=matrix.imag.ravel())


def density(vector: Matrix, qubit: int, entangled: bool) -> Matrix:
    qubits = vector.size.bit_length() - 1
    # Qubit 0 is the least significant bit of the vector's index, and so the last axis.
    axes = vector.reshape((2,) * qubits)
    first = np.moveaxis(axes, qubits - 1 - qubit, 0)
    rows = first.reshape(-1, 1) if entangled else first.reshape(2, -1)
    matrix: Matrix = rows @ rows.conj().T
    return matrix


def tell(layer: PhysicalLayer, node: str, request: TellRequest) -> Feedback:
    """Record a subroutine; refuse a text that would not be one line of a log."""
    text = request.text
    if not 0 < len(text) <= MOST or not (text.isascii() and text.isprintable()):
        raise invalid(f"text {text[:20]!r}: 1 to {MOST} printable ASCII characters are allowed")
    layer.record(node, "subroutine", detail=text)
    return Feedback(time_ns=layer.clock.now_ns(), exact=True)
