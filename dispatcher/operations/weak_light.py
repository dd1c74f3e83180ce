"""Weak pulses, of a laser or of pairs, as operations use them: on their way, and at detectors.

They stay undrawn from their source to a detector, behind losses, Paulis that photons meet each for
itself, and switches that connect one path all the while. Whatever else is done to a block draws its
photons first, for all pulses: it is a block like others then, and the event log says why. Of pairs
that is done to both halves at once, or to one whose other half was measured, or is gone.
"""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.detector import Slots, Train
from dispatcher.devices.detectors import Detection, ExtraBits
from dispatcher.devices.source import bell_states, misprepared
from dispatcher.fiber.fiber_noise import obstacle
from dispatcher.fiber.noise import (
    MEMORYLESS,
    Depolarizing,
    Loss,
    Memoryless,
    NoiseModel,
    PauliChannel,
    Schedule,
)
from dispatcher.layer import pulses
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block, BlockName, ExtraPairs
from dispatcher.layer.weak_pairs import Pairs, WeakHalf, weak_halves
from dispatcher.layer.weak_pulses import (
    BasesAt,
    Choices,
    Operators,
    Photons,
    Places,
    WeakPulses,
    by_rank,
    laser_pulses,
)
from dispatcher.operations import emission, imperfections
from dispatcher.operations.adjustment import Tap
from dispatcher.operations.paths import Step, path_of
from dispatcher.photon_random import PhotonRandom, PhotonsByKey, Source
from dispatcher.refusal import exhausted
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Register
from dispatcher.switch.optical_switch import Through
from wire.config import FiberEnd
from wire.outcomes import PAULI_BASES
from wire.parameters.physics import PairSource

# Whether a Pauli (0 I, 1 X, 2 Z, 3 XZ) flips a bit along Z, X and Y.
FLIPPED = np.array([[0, 1, 0, 1], [0, 0, 1, 1], [0, 1, 1, 0]], np.uint8)


def is_weak(source: PairSource) -> bool:
    """Whether photons that a host prepares are in pulses of a laser."""
    return source.statistics == "poisson" and not source.heralding_efficiency


def emitted(block: Block, source: PairSource, choices: Choices, draws: Source) -> WeakPulses:
    random = PhotonRandom(draws, block.name, block.draws_for("source"), choices.count)
    light = laser_pulses(source.intensities, choices, random)
    light.jitter_ps = source.jitter_ps
    if source.preparation_error:
        light.of_pulses.append((random, partial(_misprepared, source)))
    return light


def emitted_pairs(
    layer: PhysicalLayer, blocks: Sequence[Block], source: PairSource, count: int
) -> int:
    """Let new blocks be the halves of what a source of pairs emits; return how many pairs."""
    first = blocks[0]
    random = PhotonRandom(layer.draws, first.name, first.draws_for("source"), count)
    pairs = Pairs(count, source.mean_pairs, random)
    for block, light in zip(blocks, weak_halves(pairs), strict=True):
        light.jitter_ps, block.source_rate_hz = source.jitter_ps, source.max_rate_hz
        if not light.half and source.bell_probabilities()[0] < 1:
            light.of_photons.append((random, partial(_bell_states, source)))
        layer.ownership.change(block, Register(0), light)
    return int(pairs.cells.sum())


def _bell_states(source: PairSource, random: PhotonRandom) -> Bytes:
    states = bell_states(source, random)
    assert states is not None
    return states


def _misprepared(source: PairSource, random: PhotonRandom) -> Bytes:
    paulis = misprepared(source, random)
    assert paulis is not None
    return paulis


def takes_paulis(layer: PhysicalLayer, block: Block) -> bool:
    """Return whether a host can apply Paulis to a block of which no photon is drawn."""
    waits = not block.is_new and layer.waits(block)
    return block.weak is not None and not waits and layer.devices.noise(block.node, "gates") is None


def apply(layer: PhysicalLayer, block: Block, packed: bytes) -> None:
    """Apply Paulis to weak pulses, two bits for each, the first lowest."""
    light = block.weak
    assert light is not None
    p = layer.devices.of(block.node).gates.one_qubit_depolarizing
    random = imperfections.chance(layer, block)
    noise = partial(_paulis, Depolarizing(p)) if p else None
    light.applied.append(Operators(packed, random, noise))


def require(layer: PhysicalLayer, name: BlockName, node: str) -> Block:
    """Return the block of this name at the node, with all its photons drawn, or refuse."""
    block = layer.ownership.require(name, node)
    draw(layer, f"an operation of {node}", block)
    return block


def steady(model: NoiseModel, schedule: Schedule) -> NoiseModel:
    """Return a tap as the Pauli channel that it is, unless it changes while the light passes."""
    if not isinstance(model, Tap):
        return model
    least = model.fraction.lowest(schedule.first_ns, schedule.last_ns)
    most = model.fraction.highest(schedule.first_ns, schedule.last_ns)
    return PauliChannel(most / 4, 0.0, most / 4) if least == most else model


def meet(light: WeakPulses, model: NoiseModel, random: PhotonRandom) -> int:
    """Let weak pulses meet noise that is no obstacle; return how many photons are lost."""
    if isinstance(model, Loss):
        return light.pass_on(model.transmission, random, "pass")
    assert isinstance(model, MEMORYLESS)
    light.of_photons.append((random, partial(_paulis, model)))
    return 0


def _paulis(model: Memoryless, random: PhotonRandom) -> Bytes:
    paulis = model.effect(random).paulis
    assert paulis is not None
    return paulis


def cross(light: WeakPulses, passed: Through, random: PhotonRandom, rotation: int) -> int:
    """Let weak pulses pass a switch; return how many photons are lost."""
    lost = light.pass_on(passed.transmission, random, "pass")
    if rotation:
        light.of_photons.append((random, partial(_rotated, rotation)))
    return lost


def _rotated(rotation: int, random: PhotonRandom) -> Bytes:
    return np.full(random.photons, rotation, np.uint8)


def train(block: Block) -> Train:
    return Train(block.start_ns, block.interval_ns, block.size)


def prepare(layer: PhysicalLayer, block: Block, end: FiberEnd, frequency_mhz: int) -> None:
    """Get weak pulses ready for a way; refuse if they must be drawn on it and are too many."""
    if block.weak is None:
        return
    if memory := layer.waits(block):
        draw(layer, memory, block)
    elif any(_is_obstacle(step, block) for step in path_of(layer, end, frequency_mhz)):
        require_capacity(layer, block)


def _is_obstacle(step: Step, block: Block) -> bool:
    strays = step.crossing is not None and step.crossing.switch.config.crosstalk_db is not None
    models = (each for each in step.line.noise.values() if not isinstance(each, Tap))
    return strays or bool(obstacle(block.pulses.encoding, models))


def draw(layer: PhysicalLayer, why: str, *blocks: Block) -> None:
    """Draw the photons of all pulses of blocks that are weak; refuse if there are too many."""
    for block in blocks:
        if block.weak is not None:
            for drawn in _draw(layer, block, block.weak):
                layer.record(drawn.node, "draw", drawn, drawn.port, f"all pulses, for {why}")
            layer.drawn_for[why] = None


def _draw(layer: PhysicalLayer, block: Block, light: WeakPulses) -> list[Block]:
    require_capacity(layer, block)
    halves, sabot = _together(layer, block), layer.sabot
    if isinstance(light, WeakHalf) and len(halves) > 1:
        came = light.pairs.below([half.transmission for _block, half in halves])
        order = by_rank(came[0].pulses)
        lit = came[0].pulses[order[0]]
        first, others = sabot.bell_pairs(light.count), sabot.bell_pairs(order[1].size)
        for each, photons, *made in zip(halves, came, first, others, strict=True):
            _settle(layer, *each, photons, order, made)
    else:
        photons = light.photons()
        order, states = by_rank(photons.pulses), light.states(photons)
        lit = photons.pulses[order[0]]
        of_pulses = np.zeros(light.count, np.uint8)
        of_pulses[lit] = states[order[0]]
        made = [emission.prepare(sabot, each) for each in (of_pulses, states[order[1]])]
        _settle(layer, block, light, photons, order, made)
    drawn = [half for half, _light in halves]
    late_ps = light.delays_ps(lit)  # of both halves
    if late_ps is not None:
        delays_ps = np.zeros(light.count)
        delays_ps[lit] = late_ps
        for half in drawn:
            half.pulses.delays_ps = delays_ps
    return drawn


def _together(layer: PhysicalLayer, block: Block) -> list[tuple[Block, WeakPulses]]:
    """Return a weak block, with its other half if that is weak too, in their order."""
    assert block.weak is not None
    name, light = block.name._replace(half=1 - block.name.half), block.weak
    halves = [(block, light)]
    if isinstance(light, WeakHalf):
        for other in layer.ownership.parts(name):
            if isinstance(other.weak, WeakHalf) and other.weak.pairs is light.pairs:
                halves.insert(light.half, (other, other.weak))
    return halves


def _settle(
    layer: PhysicalLayer,
    block: Block,
    light: WeakPulses,
    photons: Photons,
    order: tuple[Places, Places],
    registers: Sequence[Register],
) -> None:
    """Let a block be these qubits, one for each pulse and further ones, as far as they came."""
    there, paulis = photons.fates < light.thresholds(photons), light.paulis(photons)
    present, every = np.zeros(light.count, bool), np.zeros(light.count, np.uint8)
    firsts, others = order
    pulses = photons.pulses[firsts]
    present[pulses], every[pulses] = there[firsts], paulis[firsts]
    register, further = registers
    layer.sabot.lose(register, ~present)
    layer.sabot.pauli(register, every)
    layer.ownership.change(block, register)
    if further.size:
        layer.sabot.lose(further, ~there[others])
        layer.sabot.pauli(further, paulis[others])
        block.extra_pairs = ExtraPairs(further, photons.pulses[others])


def require_capacity(layer: PhysicalLayer, block: Block) -> None:
    """Refuse if the photons of weak pulses are too many to be drawn for all pulses."""
    if block.weak is not None:
        lights = [light for _block, light in _together(layer, block)]
        photons = sum(light.count + light.most_photons(1.0) for light in lights)
        require_capacity_for(layer, block, photons)


def require_capacity_for(layer: PhysicalLayer, block: Block, photons: float) -> None:
    """Refuse if this number of photons of a block, on average, is too large to be drawn."""
    more, live = math.ceil(photons), layer.sabot.live_qubits
    share = layer.ownership.makers.places_of(block.maker) - block.places
    if live + more > layer.max_live_qubits or share + more > layer.share:
        raise exhausted(
            f"{more} photons of {block.name} may be needed, with {live} live and {share} that "
            f"{block.maker} has made: more than {layer.max_live_qubits}, or its share of "
            f"{layer.share}; make smaller blocks"
        )


def detect(
    layer: PhysicalLayer, block: Block, light: WeakPulses, place: str, bases: BasesAt
) -> tuple[Slots, Detection]:
    """Draw the photons of weak pulses that detectors see, and measure them; return the clicks."""
    detectors = layer.devices.detectors(block.node, "measure")
    best = float(detectors.efficiencies.max())
    require_capacity_for(layer, block, light.most_photons(best))
    photons = light.photons(best)
    if isinstance(light, WeakHalf):
        light.pairs.measured = bases
    random = PhotonRandom(layer.draws, block.name, block.draws_for("measure"), light.count)
    bits = _measured(layer, light, photons, random, bases)
    seen = photons.fates < detectors.efficiencies[bits] * light.thresholds(photons)
    photons, bits = photons.chosen(seen), bits[seen]
    random = PhotonRandom(layer.draws, block.name, place, light.count)
    moved_ps = _moved_ps(layer, block, light, photons, random)
    return detectors.detect_few(ExtraBits(photons.pulses, bits), train(block), random, moved_ps)


def _measured(
    layer: PhysicalLayer, light: WeakPulses, photons: Photons, random: PhotonRandom, bases: BasesAt
) -> Bytes:
    if not photons.pulses.size:
        return np.zeros(0, np.uint8)
    values = bases(photons.pulses)
    states, paulis = light.states(photons, values), light.paulis(photons)
    if (values >= PAULI_BASES).any():
        register = emission.prepare(layer.sabot, states)
        layer.sabot.pauli(register, paulis)
        return layer.sabot.measure(register, values, light.draws(photons, random))
    bits = states & np.uint8(1) ^ FLIPPED[values, paulis]
    free = states >> np.uint8(1) != values  # along another axis: either bit
    bits[free] = light.draws(photons.chosen(free), random).bits()
    return bits


def _moved_ps(
    layer: PhysicalLayer, block: Block, light: WeakPulses, photons: Photons, random: PhotonRandom
) -> NDArray[np.float64] | None:
    """Return how much later photons click than their pulses are due, shape (m,)."""
    by_pulse = PhotonsByKey.of(random, photons.pulses)
    block.pulses.delays_ps = light.delays_ps(photons.pulses)
    late = pulses.late_ps(block.pulses, by_pulse)
    jitter_ps = layer.devices.of(block.node).detectors.jitter_ps
    if not jitter_ps:
        return late
    jitters_ps = PhotonsByKey.of(random, photons.keys).normal("jitter") * jitter_ps
    return jitters_ps if late is None else jitters_ps + late
