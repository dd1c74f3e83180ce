"""Coherent rotations about the Z axis that light has met on its way: summed, then twirled once.

Angles of one photon add up over its fibres: two of .2 rad flip its phase with probability
sin^2(.4 / 2) = .0395, where two flips drawn apart would do so with .0197. So they stay angles
until something does not commute with them: a measurement, or a gate other than Z, S, T, RZ, CZ and
the control of a CX. Then the twirl turns them into Z with probability sin^2(angle / 2), which is
what a measurement along X or Y sees of them on average over the Pauli frame; not exact.
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.ownership import Block, Pulses
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.manager import NO_CLICK, Sabot

FLIPS_BIT = np.uint8(1)  # of a Pauli, and of a Bell outcome: Psi
FLIPS_PHASE = np.uint8(2)


def reflect(pulses: Pulses, paulis: NDArray[np.uint8]) -> None:
    """Bring Paulis, shape (k,), in before the angles: X R(angle) = R(-angle) X."""
    if pulses.angles_rad is None:
        return
    flipped = (paulis & FLIPS_BIT).view(np.bool_)
    if flipped.any():
        pulses.angles_rad = np.negative(
            pulses.angles_rad, where=flipped, out=pulses.angles_rad.copy()
        )


def twirl(block: Block, sabot: Sabot, draws: Draws) -> None:
    """Turn a block's angles into Paulis, before what does not commute with them."""
    angles_rad = block.pulses.angles_rad
    if angles_rad is None:
        return
    sabot.pauli(block.register, _flips(block, angles_rad, draws))
    _forget(block)


def twirl_pairs(first: Block, second: Block, outcomes: NDArray[np.uint8], draws: Draws) -> None:
    """Flip the phases of Bell outcomes, shape (k,), by the angles of both photons, in place.

    The angles of a pair add up too: in Phi by their sum, in Psi by their difference.
    """
    pair = first.pulses.angles_rad, second.pulses.angles_rad
    if pair[0] is None and pair[1] is None:
        return
    one, other = (np.zeros(len(outcomes)) if angles is None else angles for angles in pair)
    signs = np.where(outcomes & FLIPS_BIT, -1.0, 1.0)
    flips = _flips(first, one + signs * other, draws)
    np.bitwise_xor(outcomes, flips, out=outcomes, where=outcomes != NO_CLICK)
    _forget(first)
    _forget(second)


def _flips(block: Block, angles_rad: NDArray[np.float64], draws: Draws) -> NDArray[np.uint8]:
    """Draw Z or nothing for each photon, once for every fibre that it has passed."""
    purpose = f"twirl {block.fibers_passed}"
    drawn = draws.uniform(block.name, purpose, block.register.size)
    amplitudes = np.sin((angles_rad / 2).astype(np.float32))  # a tenth of the time of float64
    return (drawn < amplitudes * amplitudes) * FLIPS_PHASE


def _forget(block: Block) -> None:
    block.pulses.angles_rad, block.pulses.exact = None, False
