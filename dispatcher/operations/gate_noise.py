"""Noise of gates: depolarisation that follows each of them.

Of one qubit X, Z and XZ come with p/4 each; of two qubits each of the 15 products of Pauli
operators but the identity with p/16, on both qubits together. A pair is hit only where both are
there. A Bell measurement by gates is a CX, an H of the first qubit and two measurements. All
products being alike, the noise of the CX is the same in front of it. That of the H is not: X or XZ
after the H flips the bit of the phase alone, which in front of both gates is Z. A model of a user's
own says what it likes: then both gates are done, each with its noise, and taken back.
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import SEVERAL_IN_GATES, approximation
from dispatcher.layer import drift, further, part_noise
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask

Positions = NDArray[np.int64]

ONE_QUBIT_ERRORS, TWO_QUBIT_ERRORS = 3, 15
IDENTITY = np.uint8(0)
NOBODY, NOTHING = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.uint8)
FLIPS_BIT, FLIPS_PHASE = np.uint8(1), np.uint8(2)  # X, Z


def after_gate(layer: PhysicalLayer, block: Block, mask: Mask | None = None) -> int:
    """Let noise follow a gate on the photons of a block, or those of a mask; return the errors."""
    met = block.register.present if mask is None else block.register.present & mask
    errors = _hit(layer, block, *_one_qubit_errors(layer, block, met))
    _custom_noise(layer, block, 1, met)
    return errors


def after_pair_gate(layer: PhysicalLayer, first: Block, second: Block) -> int:
    """Let noise follow a gate on pairs of photons of two blocks; return how many it has hit."""
    p = layer.devices.of(first.node).gates.two_qubit_depolarizing
    random = _chance(layer, first)
    errors = random.events("two qubits", p * TWO_QUBIT_ERRORS / 16)
    errors = errors[(first.register.present & second.register.present)[errors]]
    products = 1 + random.which("which product", errors.size, np.ones(TWO_QUBIT_ERRORS))
    _hit(layer, first, errors, products & np.uint8(3))
    _hit(layer, second, errors, products >> np.uint8(2))
    if layer.devices.noise(first.node, "gates") is not None:
        both = first.register.present & second.register.present
        for block in (first, second):
            _custom_noise(layer, block, 2, both)
    return errors.size


def before_bell_measurement(layer: PhysicalLayer, first: Block, second: Block) -> dict[str, int]:
    """Let the noise of the gates that a Bell measurement is made of be in its outcomes."""
    if layer.devices.noise(first.node, "gates") is not None:
        errors = _by_gates_themselves(layer, first, second)
    else:
        errors = after_pair_gate(layer, first, second)
        at, paulis = _one_qubit_errors(layer, first, first.register.present)
        errors += _hit(layer, first, at, (paulis & FLIPS_BIT) * FLIPS_PHASE)
    return {"gate-errors": errors} if errors else {}


def _by_gates_themselves(layer: PhysicalLayer, first: Block, second: Block) -> int:
    """Do both gates with their noise, and take them back without; return the errors."""
    for block in (first, second):
        drift.twirl(block, layer.sabot, layer.draws)
        if block.further is not None:
            several = approximation(SEVERAL_IN_GATES, further.share(block))
            first.pulses.approximations |= second.pulses.approximations | several
    layer.sabot.gate("CX", first.register, second.register)
    errors = after_pair_gate(layer, first, second)
    layer.sabot.gate("H", first.register)
    errors += after_gate(layer, first)
    layer.sabot.gate("H", first.register)
    layer.sabot.gate("CX", first.register, second.register)
    return errors


def _custom_noise(layer: PhysicalLayer, block: Block, qubits: int, met: Mask) -> None:
    """Let a model of the user's own say what else a gate of so many qubits does to each."""
    if layer.devices.noise(block.node, "gates") is None:
        return
    block.gates += 1
    place = f"gate {block.gates}"
    own = layer.devices, layer.draws, block, "gate", "gates", place
    effect = part_noise.of_part(*own, layer.clock.now_ns(), qubits=qubits)
    if effect is not None and effect.paulis is not None:
        effect = effect._replace(paulis=effect.paulis * met)
    if effect is not None and effect.lost is not None:
        effect = effect._replace(lost=effect.lost & met)
    lost = part_noise.meet(layer.sabot, layer.draws, block, effect, place, met)
    layer.photons_lost += lost


def _one_qubit_errors(layer: PhysicalLayer, block: Block, met: Mask) -> tuple[Positions, Bytes]:
    """Draw which qubits, of those that a gate has met, it has hit, and with what."""
    p = layer.devices.of(block.node).gates.one_qubit_depolarizing
    random = _chance(layer, block)
    if not p:
        return NOBODY, NOTHING
    errors = random.events("one qubit", p * ONE_QUBIT_ERRORS / 4)
    errors = errors[met[errors]]
    return errors, 1 + random.which("which Pauli", errors.size, np.ones(ONE_QUBIT_ERRORS))


def _chance(layer: PhysicalLayer, block: Block) -> PhotonRandom:
    block.gates += 1
    place = block.draws_for(f"gate {block.gates} at {block.node}")
    return PhotonRandom(layer.draws, block.name, place, block.register.size)


def _hit(layer: PhysicalLayer, block: Block, at: Positions, ops: Bytes) -> int:
    """Apply operators to the photons at these positions."""
    if at.size:
        paulis = np.zeros(block.register.size, dtype=np.uint8)
        paulis[at] = ops
        layer.sabot.explain(block.register, f"gate of {block.node}", paulis)
        further.pauli(layer.sabot, block, paulis)
        drift.reflect(block.pulses, paulis)
    return at.size
