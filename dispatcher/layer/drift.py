"""Coherent rotations about the Z axis that light has met on its way: summed, then twirled once.

Angles of one photon add up over its fibres: two of .2 rad flip its phase with probability
sin^2(.4 / 2) = .0395, where two flips drawn apart would do so with .0197. So they stay angles
until something does not commute with them: a measurement, or a gate other than Z, S, T, RZ, CZ and
the control of a CX. Then the twirl turns them into Z with probability sin^2(angle / 2), which is
what a measurement along X or Y sees of them on average over the Pauli frame; not exact.

Rotations about any axis, of polarisation, are composed in the same way, and commute with Paulis
alone that all photons of a block meet; of Paulis that only some meet between two rotations, errors
of fibres, memories and gates are taken to come behind both.
"""

from collections.abc import Callable
from math import pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import twirled_phase, twirled_turn
from dispatcher.fiber.turn import SIGNS, TRANSPOSED, Turn, product, stretches
from dispatcher.layer.ownership import Block, Pulses
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import NO_CLICK

Angles = NDArray[np.float64]
Positions = NDArray[np.int64]

FLIPS_BIT = np.uint8(1)  # of a Pauli, and of a Bell outcome: Psi
FLIPS_PHASE = np.uint8(2)


def reflect(pulses: Pulses, paulis: NDArray[np.uint8]) -> None:
    """Bring Paulis, shape (k,), in before the angles: X R(angle) = R(-angle) X."""
    if pulses.angles_rad is not None and (paulis & FLIPS_BIT).any():
        pulses.angles_rad = _turned(pulses.angles_rad, paulis)


def twirl(block: Block, sabot: Simulation, draws: Draws) -> None:
    """Turn a block's angles into Paulis, before what does not commute with them."""
    twirl_turn(block, sabot, draws)
    angles_rad = block.pulses.angles_rad
    if angles_rad is None:
        return
    paulis = np.zeros(block.register.size, dtype=np.uint8)
    paulis[_flipped(block, _most(angles_rad), angles_rad.take, draws)] = FLIPS_PHASE
    sabot.explain(block.register, "rotation about Z on the way", paulis)
    sabot.pauli(block.register, paulis)
    if block.extra_pairs is not None:
        at = block.extra_pairs.pulses
        flips = _flipped_extra_pairs(block, angles_rad[at], draws)
        sabot.pauli(block.extra_pairs.register, flips * FLIPS_PHASE)
    _forget(block, _most(angles_rad))


def twirl_pairs(first: Block, second: Block, outcomes: NDArray[np.uint8], draws: Draws) -> None:
    """Flip the phases of Bell outcomes, shape (k,), by the angles of both photons, in place.

    The angles of a pair add up too: in Phi by their sum, in Psi by their difference.
    """
    _turn_pairs(first, second, outcomes, draws)
    one, other = first.pulses.angles_rad, second.pulses.angles_rad
    if one is None and other is None:
        return

    def total(pairs: Positions) -> Angles:
        none = np.zeros(len(pairs))
        mine, theirs = (none if angles is None else angles[pairs] for angles in (one, other))
        return mine + _turned(theirs, outcomes[pairs])

    most_rad = _most(one) + _most(other)
    pairs = _flipped(first, most_rad, total, draws)
    outcomes[pairs[outcomes[pairs] != NO_CLICK]] ^= FLIPS_PHASE
    _forget(first, most_rad)
    _forget(second, most_rad)


def turn(block: Block, more: Turn | None) -> None:
    if more is not None:
        block.pulses.turn = more.after(block.pulses.turn)


def twirl_turn(block: Block, sabot: Simulation, draws: Draws) -> None:
    """Turn a block's rotations about any axis into Paulis: X, Y and Z with x^2, y^2 and z^2.

    For a state of one basis that is measured in it, that is exactly what the rotation does.
    """
    whole = block.pulses.turn
    if whole is None:
        return
    chances = whole.quaternions[:, 1:] ** 2
    photons = [(block.register, np.arange(block.register.size), "own")]
    if block.extra_pairs is not None:
        photons.append((block.extra_pairs.register, block.extra_pairs.pulses, "further"))
    for register, pulses, which in photons:
        place = block.draws_for(f"turn {block.fibers_passed} {which}")
        random = PhotonRandom(draws, block.name, place, pulses.size)
        affected = random.events("most", float(chances.sum(axis=1).max()))
        drawn = random.generator("own").random(affected.size) * chances.sum(axis=1).max()
        paulis = np.zeros(pulses.size, dtype=np.uint8)
        paulis[affected] = _chosen(chances[whole.stretch(pulses[affected])], drawn)
        sabot.explain(register, "rotation of the polarisation on the way", paulis)
        sabot.pauli(register, paulis)
    block.pulses.turn = None
    block.pulses.approximations |= twirled_turn(whole.quaternions)


class _PairTurns(NamedTuple):
    """The effect of both halves' turns on pairs of each Bell state."""

    turn: Turn  # tells the stretches
    chances: NDArray[np.float64]  # of X, Y and Z; shape (s, 4, 3)
    whole: NDArray[np.float64]  # both together, shape (s, 4, 4)


def _of_pairs(first: Block, second: Block) -> _PairTurns | None:
    """Compose the turns of both halves: on Phi+, A and B are A B^T on the first half."""
    one, other = first.pulses.turn, second.pulses.turn
    if one is None and other is None:
        return None
    starts, former, right = stretches(one, other)
    whole = np.stack([product(former, right * TRANSPOSED * signs) for signs in SIGNS], axis=1)
    return _PairTurns(Turn(starts, former), whole[..., 1:] ** 2, whole)


def _turn_pairs(first: Block, second: Block, outcomes: NDArray[np.uint8], draws: Draws) -> None:
    """Let turns of both halves of pairs change Bell outcomes, shape (k,), in place."""
    pair_turns = _of_pairs(first, second)
    if pair_turns is None:
        return
    most = float(pair_turns.chances.sum(axis=-1).max())
    place = first.draws_for(f"turn {first.fibers_passed} pairs")
    random = PhotonRandom(draws, first.name, place, first.register.size)
    affected = random.events("most", most)
    affected = affected[outcomes[affected] != NO_CLICK]
    chances = pair_turns.chances[pair_turns.turn.stretch(affected), outcomes[affected]]
    outcomes[affected] ^= _chosen(chances, random.generator("own").random(affected.size) * most)
    for block in (first, second):
        block.pulses.turn = None
        block.pulses.approximations |= twirled_turn(pair_turns.whole)


def _chosen(chances: NDArray[np.float64], drawn: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Choose X, XZ, Z or I by chances of the first three, shape (n, 3), and draws from [0, 1)."""
    which = (drawn[:, None] >= chances.cumsum(axis=1)).sum(axis=1)
    chosen: NDArray[np.uint8] = np.array([1, 3, 2, 0], np.uint8)[which]
    return chosen


def twirl_extra_pairs(
    first: Block, second: Block, pulses: Positions, outcomes: NDArray[np.uint8], draws: Draws
) -> None:
    """The same for pairs of further photons of these pulses, before the own ones."""
    if (pair_turns := _of_pairs(first, second)) is not None:
        place = first.draws_for(f"turn {first.fibers_passed} further")
        random = PhotonRandom(draws, first.name, place, pulses.size)
        measured = np.flatnonzero(outcomes != NO_CLICK)
        chances = pair_turns.chances[pair_turns.turn.stretch(pulses[measured]), outcomes[measured]]
        outcomes[measured] ^= _chosen(chances, random.uniform("own")[measured])
    one, other = first.pulses.angles_rad, second.pulses.angles_rad
    if one is None and other is None:
        return
    total = np.zeros(pulses.size) if one is None else one[pulses]
    if other is not None:
        total = total + _turned(other[pulses], outcomes)
    flips = _flipped_extra_pairs(first, total, draws) & (outcomes != NO_CLICK)
    outcomes[flips] ^= FLIPS_PHASE


def _flipped_extra_pairs(block: Block, angles_rad: Angles, draws: Draws) -> NDArray[np.bool_]:
    place = block.draws_for(f"twirl {block.fibers_passed} further")
    drawn = PhotonRandom(draws, block.name, place, angles_rad.size).uniform("own")
    flipped: NDArray[np.bool_] = drawn < np.sin(angles_rad / 2) ** 2
    return flipped


def _most(angles_rad: Angles | None) -> float:
    return 0.0 if angles_rad is None else max(float(angles_rad.max()), -float(angles_rad.min()))


def _flipped(
    block: Block, most_rad: float, angles_of: Callable[[Positions], Angles], draws: Draws
) -> Positions:
    """Draw whose phases flip, once for every fibre that the block has passed.

    None flips more likely than by the most of the angles: those that would so are drawn first,
    and of them as many are taken as their own angles say.
    """
    most = sin(min(most_rad, pi) / 2) ** 2
    place = block.draws_for(f"twirl {block.fibers_passed}")
    random = PhotonRandom(draws, block.name, place, block.register.size)
    photons = random.events("most", most)
    likely = np.sin(angles_of(photons) / 2) ** 2
    return photons[random.generator("own").random(photons.size) * most < likely]


def _turned(angles_rad: NDArray[np.float64], flips: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Negate those angles whose flips are odd, by their sign bits: a tenth of the time of where."""
    signs = flips.astype(np.uint64) << np.uint64(63)
    return (angles_rad.view(np.uint64) ^ signs).view(np.float64)


def _forget(block: Block, most_rad: float) -> None:
    block.pulses.angles_rad = None
    block.pulses.approximations |= twirled_phase(most_rad)
