"""Photons of further pairs in the pulses of a block: each is a qubit of its own.

    pulse          0   1   2   3
    own photon     a   b   -   c
    further            d   -   e        register d e f, pulses 1 3 3
                               f

An operation on a pulse acts on all its photons, each of which is lost, errs and is measured by
itself. Gates on two blocks, and their noise, act on the pulses' own photons alone. Light without a
state, such as Raman noise, is counted (`Pulses.extras`), not simulated.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.detectors import ExtraBits
from dispatcher.fiber.noise import Effect
from dispatcher.layer import pulses
from dispatcher.layer.ownership import Block, ExtraPairs
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Angle, Bytes, GateName
from dispatcher.sabot.draws import Draws, PhotonDraws
from dispatcher.sabot.registers import Mask, Pick, Register
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import NO_CLICK

RANKS = 256  # a pulse has fewer photons
NOBODY = -1


class Photons(NamedTuple):
    """Photons of a block that err each by itself: the own ones of its pulses, or further ones."""

    register: Register
    pulses: NDArray[np.int64] | slice  # the pulse of each
    random: PhotonRandom


def by_themselves(block: Block, random: PhotonRandom) -> Iterator[Photons]:
    """Yield the own photons of a block and the further ones, with random numbers of their own."""
    yield Photons(block.register, slice(None), random)
    if block.extra_pairs is not None:
        light = block.extra_pairs
        yield Photons(light.register, light.pulses, random.beside(light.pulses.size))


def owners(photons: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the pulse of each photon beside the first, of counts in pulses; ascending."""
    several = np.flatnonzero(photons > 1)
    return np.repeat(several, photons[several] - 1)


def lit(block: Block) -> Mask:
    """Return in which pulses of a block there is light: a photon of its own, or another."""
    light = pulses.lit(block)
    if block.extra_pairs is not None:
        light = light.copy()
        light[block.extra_pairs.present_pulses] = True
    return light


def share(block: Block) -> float:
    if block.extra_pairs is None:
        return 0.0
    there = block.extra_pairs.present_pulses
    return np.unique(there).size / max(1, int(np.count_nonzero(held(block))))


def several(first: Block, second: Block) -> Mask | None:
    """Return which pulses of two blocks have two photons or more, of which not all are own ones.

    None if no pulse has a further photon.
    """
    lights = [block.extra_pairs for block in (first, second) if block.extra_pairs is not None]
    if not lights:
        return None
    size = first.register.size
    there = np.concatenate([light.present_pulses for light in lights])
    more = np.bincount(there, minlength=size)
    counts = first.register.present.astype(np.int64) + second.register.present
    return np.asarray((more > 0) & (more + counts > 1))


def held(block: Block) -> Mask:
    present = block.register.present
    if block.extra_pairs is not None:
        present = present.copy()
        present[block.extra_pairs.present_pulses] = True
    return present


def pauli(sabot: Simulation, block: Block, paulis: Bytes) -> None:
    """Apply to all photons of a pulse the same operator; shape (k,)."""
    sabot.pauli(block.register, paulis)
    if block.extra_pairs is not None:
        sabot.pauli(block.extra_pairs.register, paulis[block.extra_pairs.pulses])


def gate(sabot: Simulation, block: Block, name: GateName, angle_rad: Angle) -> None:
    if block.extra_pairs is not None:
        angles = (
            angle_rad[block.extra_pairs.pulses] if isinstance(angle_rad, np.ndarray) else angle_rad
        )
        sabot.gate(name, block.extra_pairs.register, angle_rad=angles)


def meet(sabot: Simulation, block: Block, members: Mask, effect: Effect) -> None:
    light = block.extra_pairs
    if light is None:
        return
    here = members[light.pulses]
    if effect.paulis is not None:
        sabot.pauli(light.register, effect.paulis * here)
    if effect.lost is not None:
        sabot.lose(light.register, effect.lost & here)


def thin(
    sabot: Simulation,
    block: Block,
    members: Mask,
    transmission: float | NDArray[np.float64],
    random: PhotonRandom,
    purpose: str,
) -> None:
    """Let each photon beside the own ones of the members' pulses through so likely."""
    pulses.thin(block.pulses, members, transmission, random, purpose)
    light = block.extra_pairs
    if light is None:
        return
    if isinstance(transmission, np.ndarray):
        transmission = transmission[light.pulses]
    drawn = random.generator(f"{purpose} of pairs").random(light.pulses.size)
    sabot.lose(light.register, (drawn >= transmission) & members[light.pulses])


def darken(sabot: Simulation, block: Block, members: Mask) -> None:
    """Take all but the own photons out of the members' pulses."""
    pulses.darken(block.pulses, members)
    if block.extra_pairs is not None:
        sabot.lose(block.extra_pairs.register, members[block.extra_pairs.pulses])


def part(sabot: Simulation, block: Block, members: Mask) -> ExtraPairs | None:
    """Take the members' further photons out of a block."""
    return (
        None
        if block.extra_pairs is None
        else part_of(sabot, block, members[block.extra_pairs.pulses])
    )


def part_of(sabot: Simulation, block: Block, members: Mask) -> ExtraPairs | None:
    """Take some further photons, shape (m,), out of a block."""
    light = block.extra_pairs
    return light and ExtraPairs(sabot.part(light.register, members), light.pulses)


def unite(sabot: Simulation, block: Block, other: Block) -> None:
    if block.extra_pairs is None:
        block.extra_pairs = other.extra_pairs
    elif other.extra_pairs is not None:
        sabot.unite(block.extra_pairs.register, other.extra_pairs.register)


def gather(
    sabot: Simulation, picked: Sequence[tuple[Block, NDArray[np.uint32]]]
) -> ExtraPairs | None:
    """Take the further photons of pulses at these positions of blocks, one after the other."""
    start, picks, places = 0, [], []
    for block, positions in picked:
        if block.extra_pairs is not None:
            new = np.full(block.register.size, NOBODY)
            new[positions] = np.arange(start, start + positions.size)
            new = new[block.extra_pairs.pulses]
            chosen = np.flatnonzero(new != NOBODY)
            chosen = chosen[np.argsort(new[chosen], kind="stable")]
            if chosen.size:
                picks.append(Pick(block.extra_pairs.register, chosen.astype(np.uint32)))
                places.append(new[chosen])
        start += positions.size
    return ExtraPairs(sabot.gather(picks), np.concatenate(places)) if picks else None


def drop(sabot: Simulation, block: Block, draws: Draws) -> None:
    if block.extra_pairs is not None:
        sabot.drop(
            block.extra_pairs.register,
            _draws(block, "discard", draws, block.extra_pairs.pulses.size),
        )
        block.extra_pairs = None


def measure(
    sabot: Simulation, block: Block, bases: Bytes, draws: Draws, purpose: str
) -> ExtraBits | None:
    """Measure the further photons, each in the basis of its pulse; bases have shape (k,)."""
    light = block.extra_pairs
    if light is None:
        return None
    bits = sabot.measure(
        light.register, bases[light.pulses], _draws(block, purpose, draws, light.pulses.size)
    )
    block.extra_pairs = None
    there = bits != NO_CLICK
    return ExtraBits(light.pulses[there], bits[there])


class Matched(NamedTuple):
    """Further photons of two blocks: those that pair up, and those that are alone in their arm."""

    pulses: NDArray[np.int64]
    outcomes: Bytes  # Bell states; NO_CLICK: one of the two is lost
    alone: tuple[NDArray[np.int64], NDArray[np.int64]]  # the pulses, for either block


def bell_measure(sabot: Simulation, first: Block, second: Block, draws: Draws) -> Matched | None:
    """Measure further photons in the Bell basis: the n-th of a pulse with the n-th of the other."""
    blocks = first, second
    if all(block.extra_pairs is None for block in blocks):
        return None
    mine, yours = (_ranks(block.extra_pairs) for block in blocks)
    both, *chosen = np.intersect1d(mine, yours, assume_unique=True, return_indices=True)
    alone, registers = [], []
    for block, places in zip(blocks, chosen, strict=True):
        rest, taken = _take(sabot, block.extra_pairs, places)
        alone.append(rest)
        registers.append(taken)
    matched = both // RANKS
    one, other = registers
    outcomes = np.zeros(0, np.uint8)
    if one is not None and other is not None:
        present = one.present, other.present
        alone = [
            np.concatenate([rest, matched[here & ~there]])
            for rest, here, there in zip(alone, present, present[::-1], strict=True)
        ]
        purposes = [_draws(block, "measure", draws, matched.size) for block in blocks]
        outcomes = sabot.bell_measure(one, other, (purposes[0], purposes[1]))
    for block, register in zip(blocks, registers, strict=True):
        if block.extra_pairs is not None and block.extra_pairs.register is register:
            block.extra_pairs = None  # it is used up
        drop(sabot, block, draws)
    return Matched(matched, outcomes, (alone[0], alone[1]))


def _ranks(light: ExtraPairs | None) -> NDArray[np.int64]:
    if light is None:
        return np.zeros(0, np.int64)
    starts = np.flatnonzero(np.diff(light.pulses, prepend=NOBODY))
    first = np.repeat(starts, np.diff(starts, append=light.pulses.size))
    return light.pulses * RANKS + np.arange(light.pulses.size) - first


def _take(
    sabot: Simulation, light: ExtraPairs | None, places: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Register | None]:
    """Take photons out of further ones; return the pulses of those left that are there."""
    if light is None:
        return np.zeros(0, np.int64), None
    rest = light.register.present.copy()
    rest[places] = False
    if not places.size:
        return light.pulses[rest], None
    if places.size == light.pulses.size:  # they all pair up, in their order
        return light.pulses[rest], light.register
    taken = sabot.gather([Pick(light.register, places.astype(np.uint32))])
    return light.pulses[rest], taken


def _draws(block: Block, purpose: str, draws: Draws, count: int) -> PhotonDraws:
    return draws.photons(block.name, block.draws_for(f"{purpose} further"), count)
