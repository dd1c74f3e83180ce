"""Lets what a noise model of a user's own says happen to the qubits of a block."""

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.hardware import Devices
from dispatcher.fiber.noise import Effect
from dispatcher.layer import drift, further
from dispatcher.layer.kraus import Channels, in_bases
from dispatcher.layer.ownership import Block
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.registers import Mask, everything
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import NO_CLICK

BIT, BELL_STATE = np.uint8(1), np.uint8(3)


def of_part(
    devices: Devices,
    draws: Draws,
    block: Block,
    what: str,
    part: str,
    place: str,
    time_ns: int,
    waited_s: NDArray[np.float64] | None = None,
    qubits: int = 1,
) -> Effect | None:
    """Return what happens to a block in a part of its node's device; None where nothing can."""
    model = devices.noise(block.node, part)
    if model is None:
        return None
    if waited_s is None:
        waited_s = np.zeros(block.register.size)
    own = block.draws_for(place)
    effect = model.effect(draws, block.name, what, own, time_ns, waited_s, qubits)
    block.pulses.approximations |= effect.approximations
    return effect


def meet(
    sabot: Simulation,
    draws: Draws,
    block: Block,
    effect: Effect | None,
    place: str,
    members: Mask | None = None,
) -> int:
    """Let it happen to all members that are in a block; return how many qubits are lost.

    The place is what of_part was told, so that each has random numbers of its own.
    """
    if effect is None:
        return 0
    if effect.paulis is not None:
        sabot.explain(block.register, f"noise of its own at {block.node}", effect.paulis)
        further.pauli(sabot, block, effect.paulis)
        drift.reflect(block.pulses, effect.paulis)
    if effect.kraus is not None:
        channels = Channels(sabot, draws, block, place, f"noise at {block.node}")
        channels.settle()
        channels.act(effect.kraus, everything(block.register.size) if members is None else members)
    if effect.lost is None:
        return 0
    further.darken(sabot, block, effect.lost)
    return sabot.lose(block.register, effect.lost)


def in_front(
    sabot: Simulation, draws: Draws, block: Block, effect: Effect | None, place: str, bases: Bytes
) -> None:
    """Let Kraus operators act in front of detectors that tell each qubit's basis, shape (k,).

    They are of what is told: |0> is the state that is told as 0, whatever the basis. Of a Bell
    measurement they act on the first half, in the basis 0.
    """
    if effect is not None and effect.kraus is not None:
        operators = in_bases(effect.kraus, bases)
        meet(sabot, draws, block, Effect(kraus=operators), place)


def told(found: Bytes, effect: Effect | None, bits: np.uint8 = BIT) -> Bytes:
    """Return what is told of outcomes: X flips a bit, of a Bell state X the parity, Z the phase."""
    if effect is None:
        return found
    flips = np.zeros(found.size, np.uint8) if effect.paulis is None else effect.paulis.copy()
    flips &= bits
    flips[found == NO_CLICK] = 0
    outcomes = found ^ flips
    if effect.lost is not None:
        outcomes[effect.lost] = NO_CLICK
    return outcomes
