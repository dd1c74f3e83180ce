"""Decoherence in memories: each photon of a pulse decays by itself while it waits."""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dispatcher.approximations import RELAXATION, approximation
from dispatcher.devices.decay import LEAST, Decay, Each, Waits, decay
from dispatcher.layer import drift, extra_pairs
from dispatcher.layer.ownership import Block
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.draws import Draws
from dispatcher.sabot.registers import Mask, Register
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import ERRORS
from wire.parameters.physics import Memory

PHASE = np.uint8(2)  # flips it: Z
STRETCHES = 64  # of a block, in each of which qubits have waited much the same


class Waiting(NamedTuple):
    """Photons that have waited, each by itself: the own ones of pulses, or the further ones."""

    register: Register
    waits: Waits
    random: PhotonRandom
    kind: str  # what tells the draws of further photons from those of own ones


def lose(
    sabot: Simulation,
    block: Block,
    memory: Memory,
    waits: Waits,
    random: PhotonRandom,
    efficiency: Each,
) -> int:
    """Lose the photons that cannot be read any more; return how many pulses lose their own."""
    if memory.retrieval_s < np.inf:
        if waits.alike:
            waited_s: Each = waits.longest_s
        else:
            waited_s = waits.of(np.arange(waits.qubits))
        efficiency = efficiency * np.exp(-waited_s / memory.retrieval_s)
    if np.all(efficiency == 1):
        return 0
    everything = np.ones(random.photons, dtype=bool)
    extra_pairs.thin(sabot, block, everything, efficiency, random, "further photons")
    lost = 1 - efficiency
    missing = lost if isinstance(lost, np.ndarray) else float(lost)
    return sabot.lose(block.register, random.happens("efficiency", missing))


def damp(sabot: Simulation, draws: Draws, block: Block, memory: Memory, waits: Waits) -> None:
    """Let what is damped pass from qubits into others that nobody sees; or raise TooLarge."""
    if not decay(memory, waits.longest_s).damped:
        return
    share = decay(memory, waits.of(np.arange(waits.qubits))).damped
    purpose = block.draws_for(f"damped {block.fibers_passed}, {block.stores}")
    _damp_each(sabot, draws, block, block.register, share, purpose)
    if block.extra_pairs is not None:
        of_extra_pairs = share[block.extra_pairs.pulses] if isinstance(share, np.ndarray) else share
        _damp_each(
            sabot, draws, block, block.extra_pairs.register, of_extra_pairs, f"{purpose} further"
        )


def _damp_each(
    sabot: Simulation, draws: Draws, block: Block, register: Register, share: Each, purpose: str
) -> None:
    angle_rad = np.arcsin(np.sqrt(share))
    unseen = sabot.zeros(register.size)
    try:
        rotation = GateStep("RY", angle_rad=angle_rad)
        sabot.require_capacity(unseen, [rotation, GateStep("CX", register)])
        sabot.gate("RY", unseen, angle_rad=angle_rad)
        sabot.gate("CX", register, unseen)
        sabot.gate("RY", unseen, angle_rad=-angle_rad)
        sabot.gate("CX", register, unseen)
        sabot.gate("CX", unseen, register)
    finally:
        sabot.drop(unseen, draws.photons(block.name, purpose, register.size))


def decohere(
    sabot: Simulation,
    draws: Draws,
    block: Block,
    memory: Memory,
    waits: Waits,
    random: PhotonRandom,
) -> Counter[str]:
    """Reset photons and let Paulis happen to them; return to how many, for the event log."""
    counts: Counter[str] = Counter()
    worst = decay(memory, waits.longest_s)
    for photons in _photons(block, waits, random):
        if worst.reset:
            counts["reset"] += _reset(sabot, draws, block, memory, photons)
        for paulis, names in _paulis(memory, worst, photons):
            where = f"memory of {block.node}"
            sabot.explain(photons.register, f"{names[0]} in the {where}", paulis)
            sabot.pauli(photons.register, paulis)
            if photons.register is block.register:
                drift.reflect(block.pulses, paulis)
            tally = np.bincount(paulis, minlength=4)
            for name, count in zip(names[1:], tally[1:], strict=True):
                counts[name] += int(count)
    if not worst.exact:  # the twirl leaves out the shift to |0>: (1 - e^(-t / T1)) Z / 2
        most = -float(np.expm1(-waits.longest_s / memory.t1_s)) / 2
        block.pulses.approximations |= approximation(RELAXATION, most)
    return counts


def _photons(block: Block, waits: Waits, random: PhotonRandom) -> Iterator[Waiting]:
    yield Waiting(block.register, waits, random, "")
    light = block.extra_pairs
    if light is None:
        return
    count = light.pulses.size
    if waits.alike:
        photon_waits = Waits(waits.longest_s, 0.0, count)
    else:
        photon_waits = Waits(0.0, 0.0, count, waits.of(light.pulses))
    yield Waiting(light.register, photon_waits, random.beside(count), " further")


def _reset(sabot: Simulation, draws: Draws, block: Block, memory: Memory, photons: Waiting) -> int:
    """Put photons that have relaxed into |0>; return how many."""
    affected = _met("reset", memory, photons) & photons.register.present
    count = int(np.count_nonzero(affected))
    if count:
        purpose = block.draws_for(f"reset {block.fibers_passed}, {block.stores}{photons.kind}")
        sabot.reset(
            photons.register, affected, draws.photons(block.name, purpose, photons.register.size)
        )
    return count


def _paulis(
    memory: Memory, worst: Decay, photons: Waiting
) -> Iterator[tuple[Bytes, tuple[str, ...]]]:
    """Yield what happens to photons: operators, why, and the names under which each is counted."""
    present = photons.register.present
    if worst.error:
        # A reset and a Pauli exclude each other, but Z does nothing to what has been reset.
        affected = _met("error", memory, photons) & present
        paulis = affected.view(np.uint8) * PHASE
        if worst.x:
            some = np.flatnonzero(affected)
            paulis[some] = 1 + _which(decay(memory, photons.waits.of(some)), photons.random)
        yield paulis, ("decay", *ERRORS)
    if worst.depolarized:
        hit = np.flatnonzero(_met("depolarized", memory, photons) & present)
        paulis = np.zeros(photons.register.size, np.uint8)
        paulis[hit] = 1 + photons.random.which("depolarized by", hit.size, np.ones(3))
        yield paulis, ("noise", *("depolarized",) * 3)


def _met(what: str, memory: Memory, photons: Waiting) -> Mask:
    """Draw to which photons something has happened, a part of Decay; shape (k,)."""
    _register, waits, random, _kind = photons
    if waits.alike:
        return random.happens(what, getattr(decay(memory, waits.longest_s), what))
    if waits.each_s is not None:
        return random.happens(what, getattr(decay(memory, waits.each_s), what))
    # Each stretch first as if all its qubits had waited as short as any of them; what it is
    # likelier than that is little, so that few need a probability of their own.
    stretch = -(-waits.qubits // STRETCHES)
    starts = np.arange(0, waits.qubits, stretch)
    ends = np.minimum(starts + stretch, waits.qubits) - 1
    edges = [getattr(decay(memory, waits.of(at)), what) for at in (starts, ends)]
    least = np.minimum(*edges)
    affected = random.happens_by_stretch(what, least, stretch)
    likelier = float(((np.maximum(*edges) - least) / np.maximum(1 - least, LEAST)).max())
    some = random.events(f"{what}, longer", likelier)
    shares, surely = getattr(decay(memory, waits.of(some)), what), least[some // stretch]
    drawn = random.generator(f"{what}, own wait").random(some.size) * likelier
    affected[some[drawn * np.maximum(1 - surely, LEAST) < shares - surely]] = True
    return affected


def _which(happened: Decay, random: PhotonRandom) -> NDArray[np.uint8]:
    """Choose which Pauli has happened to each qubit: 0 X, 1 Z, 2 XZ."""
    up_to_x, up_to_z = np.asarray(happened.x), np.asarray(happened.x + happened.z)
    drawn = random.generator("Pauli").random(up_to_x.size) * (up_to_z + happened.y)
    numbers: NDArray[np.uint8] = (drawn >= up_to_x).view(np.uint8) + (drawn >= up_to_z)
    return numbers
