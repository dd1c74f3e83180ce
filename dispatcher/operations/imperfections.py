"""Imperfections of devices at work: the time that they take, and flips of what is made or read.

All qubits of a block are acted on at once. The errors of the operation include the wait meanwhile;
other qubits in the node's memory decohere by the clock, and so do those of other nodes. Light is
exempt: modulators and detectors keep up with it.

Noise of gates: depolarisation that follows each of them.

Of one qubit X, Z and XZ come with p/4 each; of two qubits each of the 15 products of Pauli
operators but the identity with p/16, on both qubits together. A pair is hit only where both are
there. A Bell measurement by gates is a CX, an H of the first qubit and two measurements. All
products being alike, the noise of the CX is the same in front of it. That of the H is not: X or XZ
after the H flips the bit of the phase alone, which in front of both gates is Z. A model of a user's
own says what it likes: then both gates are done, each with its noise, and taken back.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import SEVERAL_IN_GATES, approximation
from dispatcher.fiber.noise import Effect
from dispatcher.layer import device_noise, drift, extra_pairs
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask, Register, everything
from wire.dispatcher_pb2 import Feedback
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Gates

Positions = NDArray[np.int64]

ONE_QUBIT_ERRORS, TWO_QUBIT_ERRORS = 3, 15
IDENTITY = np.uint8(0)
IN_FRONT_OF_H = np.array([0, 2, 0, 2], np.uint8)  # X and XZ behind it flip the bit: Z in front


def after_gate(layer: PhysicalLayer, block: Block, mask: Mask | None = None) -> int:
    """Let noise follow a gate on the photons of a block, or those of a mask; return the errors.

    Each photon of a pulse errs by itself.
    """
    members = everything(block.register.size) if mask is None else mask
    errors = _hit_each(layer, block, members, np.arange(ONE_QUBIT_ERRORS + 1, dtype=np.uint8))
    _custom_noise(layer, block, 1, members)
    return errors


def after_pair_gate(layer: PhysicalLayer, first: Block, second: Block) -> int:
    """Let noise follow a gate on pairs of photons of two blocks; return how many it has hit."""
    p = layer.devices.of(first.node).gates.two_qubit_depolarizing
    random = chance(layer, first)
    errors = random.events("two qubits", p * TWO_QUBIT_ERRORS / 16)
    both = first.register.present & second.register.present
    errors = errors[both[errors]]
    products = 1 + random.which("which product", errors.size, np.ones(TWO_QUBIT_ERRORS))
    for block, paulis in ((first, products & np.uint8(3)), (second, products >> np.uint8(2))):
        drift.reflect(block.pulses, _hit(layer, block, block.register, errors, paulis))
    if layer.devices.noise(first.node, "gates") is not None:
        for block in (first, second):
            _custom_noise(layer, block, 2, both)
    return errors.size


def before_bell_measurement(layer: PhysicalLayer, first: Block, second: Block) -> dict[str, int]:
    if layer.devices.noise(first.node, "gates") is not None:
        errors = _by_gates_themselves(layer, first, second)
    else:
        errors = after_pair_gate(layer, first, second)
        errors += _hit_each(layer, first, everything(first.register.size), IN_FRONT_OF_H)
    return {"gate-errors": errors} if errors else {}


def _by_gates_themselves(layer: PhysicalLayer, first: Block, second: Block) -> int:
    """Do both gates with their noise, and take them back without; return the errors."""
    for block in (first, second):
        drift.twirl(block, layer.sabot, layer.draws)
        if block.extra_pairs is not None:
            several = approximation(SEVERAL_IN_GATES, extra_pairs.share(block))
            first.pulses.approximations |= second.pulses.approximations | several
    layer.sabot.gate("CX", first.register, second.register)
    errors = after_pair_gate(layer, first, second)
    layer.sabot.gate("H", first.register)
    errors += after_gate(layer, first)
    layer.sabot.gate("H", first.register)
    layer.sabot.gate("CX", first.register, second.register)
    return errors


def _custom_noise(layer: PhysicalLayer, block: Block, qubits: int, members: Mask) -> None:
    model = layer.devices.noise(block.node, "gates")
    if model is None:
        return
    block.gates += 1
    place, now_ns = f"gate {block.gates}", layer.clock.now_ns()
    effect = device_noise.effect_of(model, layer.draws, block, "gate", place, now_ns, qubits=qubits)
    lost = device_noise.meet(layer.sabot, layer.draws, block, effect, place, members, qubits == 1)
    layer.photons_lost += lost


def _hit_each(layer: PhysicalLayer, block: Block, members: Mask, as_paulis: Bytes) -> int:
    """Let a gate on one qubit err, with each photon by itself; return how many errors there are.

    `as_paulis` says which operator each of I, X, Z and XZ is where it acts, shape (4,).
    """
    p = layer.devices.of(block.node).gates.one_qubit_depolarizing
    draws, count = chance(layer, block), 0
    if not p:
        return 0
    for register, pulses, random in extra_pairs.by_themselves(block, draws):
        errors = random.events("one qubit", p * ONE_QUBIT_ERRORS / 4)
        errors = errors[(members[pulses] & register.present)[errors]]
        drawn = 1 + random.which("which Pauli", errors.size, np.ones(ONE_QUBIT_ERRORS))
        paulis = _hit(layer, block, register, errors, as_paulis[drawn])
        if register is block.register:
            drift.reflect(block.pulses, paulis)
        count += errors.size
    return count


def chance(layer: PhysicalLayer, block: Block) -> PhotonRandom:
    """Return what draws the errors of one more gate on a block."""
    block.gates += 1
    place = block.draws_for(f"gate {block.gates} at {block.node}")
    return PhotonRandom(layer.draws, block.name, place, block.size)


def _hit(
    layer: PhysicalLayer, block: Block, register: Register, at: Positions, ops: Bytes
) -> Bytes:
    """Apply operators to the photons at these positions of a register; return those of all."""
    paulis = np.zeros(register.size, dtype=np.uint8)
    if at.size:
        paulis[at] = ops
        layer.sabot.explain(register, f"gate of {block.node}", paulis)
        layer.sabot.pauli(register, paulis)
    return paulis


def of_gates(gates: Gates, one_qubit: int, two_qubit: int) -> float:
    """Return how many seconds these gates take one after the other."""
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
    model = layer.devices.noise(block.node, "detectors")
    if model is None:
        return None
    now_ns = layer.clock.now_ns()
    return device_noise.effect_of(model, layer.draws, block, "detectors", place, now_ns)


def misread(
    layer: PhysicalLayer, block: Block, outcomes: Bytes, what: str, bits: int = 1
) -> tuple[Bytes, int]:
    """Return the outcomes as read, of this number of bits each, and how many are wrong.

    Two bits are of a Bell measurement by gates; one is of a qubit that is kept, or of light.
    """
    device = layer.devices.of(block.node)
    by_gates = block.kept or bits > 1
    error = device.gates.readout_error if by_gates else device.detectors.readout_error
    if not error:
        return outcomes, 0
    place = block.draws_for(f"readout, {what} {block.resends}")
    random = PhotonRandom(layer.draws, block.name, place, outcomes.size)
    flips = np.zeros(outcomes.size, np.uint8)
    for bit in range(bits):
        flips[random.events(f"bit {bit}", error)] ^= np.uint8(1 << bit)
    flips[outcomes == NO_CLICK] = 0
    return outcomes ^ flips, int(np.count_nonzero(flips))


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
