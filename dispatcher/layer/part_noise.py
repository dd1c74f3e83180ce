"""Lets what a noise model of a user's own says happen to the qubits of a block."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.part_noise import PartNoise
from dispatcher.fiber.noise import Effect
from dispatcher.layer import drift, pulses
from dispatcher.layer.kraus import Channels, in_bases
from dispatcher.layer.ownership import Block
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.registers import Mask, Register, everything
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import NO_CLICK

BIT, BELL_STATE = np.uint8(1), np.uint8(3)


def effect_of(
    model: PartNoise,
    draws: Draws,
    block: Block,
    what: str,
    place: str,
    time_ns: int,
    *,
    waited_s: NDArray[np.float64] | None = None,
    qubits: int = 1,
) -> Effect:
    """Return the effect on a block in a part of its node's device.

    First on the own photon of each pulse, then on the others; for detectors, on the outcome of each
    pulse.
    """
    if waited_s is None:
        waited_s = np.zeros(block.register.size)
    if what != "detectors" and block.further is not None:
        waited_s = np.concatenate([waited_s, waited_s[block.further.pulses]])
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
    with_further: bool = True,
) -> int:
    """Let it happen to the photons of the members' pulses; return how many qubits are lost.

    The place is that of `effect_of`, so that each has random numbers of its own.
    """
    if effect is None:
        return 0
    if members is None:
        members = everything(block.register.size)
    if effect.paulis is not None:
        for register, met, here in _photons(block, members, with_further):
            paulis = effect.paulis[here] * met
            sabot.explain(register, f"noise of its own at {block.node}", paulis)
            sabot.pauli(register, paulis)
            if register is block.register:
                drift.reflect(block.pulses, paulis)
    if effect.kraus is not None:
        channels = Channels(sabot, draws, block, place, f"noise at {block.node}")
        channels.settle()
        channels.act(effect.kraus, members)
    if effect.lost is None:
        return 0
    pulses.darken(block.pulses, effect.lost[: members.size] & members)
    gone = _photons(block, members, with_further)
    return sum(sabot.lose(register, effect.lost[here] & met) for register, met, here in gone)


def _photons(
    block: Block, members: Mask, with_further: bool
) -> Iterator[tuple[Register, Mask, slice]]:
    """Yield own and further photons: which are of the members, and where an effect has them."""
    size = block.register.size
    yield block.register, members, slice(size)
    if block.further is not None and with_further:
        yield block.further.register, members[block.further.pulses], slice(size, None)


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
