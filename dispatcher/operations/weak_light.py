"""Weak pulses of a laser as operations use them: on fibres and switches, and at detectors.

They stay undrawn from their source to a detector, behind losses, Paulis that photons meet each for
itself, and switches that connect one path all the while. Whatever else is done to a block draws its
photons first, for all pulses: it is a block like others then, and the event log says why.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dispatcher.devices.detector import Slots, Train
from dispatcher.devices.detectors import Detection, ExtraBits
from dispatcher.devices.source import misprepared
from dispatcher.fiber.fiber_noise import obstacle
from dispatcher.fiber.noise import (
    MEMORYLESS,
    Loss,
    Memoryless,
    NoiseModel,
    PauliChannel,
    Schedule,
)
from dispatcher.layer import pulses
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block, BlockName, ExtraPairs
from dispatcher.layer.weak_pulses import (
    Choices,
    Photons,
    WeakPulses,
    first_of_each,
    weak_pulses,
)
from dispatcher.operations import emission
from dispatcher.operations.adjustment import Tap
from dispatcher.operations.paths import Step, path_of
from dispatcher.photon_random import PhotonRandom, PhotonsByKey, Source
from dispatcher.refusal import exhausted
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Register
from dispatcher.switch.optical_switch import Through
from wire.config import FiberEnd
from wire.keyed import identities
from wire.parameters.physics import PairSource

BasesAt = Callable[[Slots], Bytes]  # the bases of some pulses


def is_weak(source: PairSource) -> bool:
    """Whether photons that a host prepares are in pulses of a laser."""
    return source.statistics == "poisson" and not source.heralding_efficiency


def emitted(block: Block, source: PairSource, choices: Choices, draws: Source) -> WeakPulses:
    """Return the light of a laser in a new block."""
    random = PhotonRandom(draws, block.name, block.draws_for("source"), choices.count)
    light = weak_pulses(source.intensities, choices, random)
    light.jitter_ps = source.jitter_ps
    if source.preparation_error:
        light.of_pulses.append((random, partial(_misprepared, source)))
    return light


def _misprepared(source: PairSource, random: PhotonRandom) -> Bytes:
    paulis = misprepared(source, random)
    assert paulis is not None
    return paulis


def require(layer: PhysicalLayer, name: BlockName, node: str) -> Block:
    """Return the block of this name at the node, with all its photons drawn, or refuse."""
    block = layer.ownership.require(name, node)
    draw(layer, f"an operation of {node}", block)
    return block


def steady(model: NoiseModel, schedule: Schedule) -> NoiseModel:
    """Return a tap as the Pauli channel that it is, unless it changes while the light passes."""
    if not isinstance(model, Tap):
        return model
    during = schedule.first_ns, schedule.last_ns
    least, most = model.fraction.lowest(*during), model.fraction.highest(*during)
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
            _draw(layer, block, block.weak)
            layer.drawn_for[why] = None
            layer.record(block.node, "draw", block, block.port, f"all pulses, for {why}")


def _draw(layer: PhysicalLayer, block: Block, light: WeakPulses) -> None:
    require_capacity(layer, block)
    photons = light.photons()
    paulis, own = light.paulis(photons), first_of_each(photons.pulses)
    register = emission.prepare(layer.sabot, light.choices.states(np.arange(light.count)))
    present = np.zeros(light.count, bool)
    present[photons.pulses[own]] = True
    every = np.zeros(light.count, np.uint8)
    every[photons.pulses[own]] = paulis[own]
    layer.sabot.lose(register, ~present)
    layer.sabot.pauli(register, every)
    layer.ownership.change(block, register)
    block.pulses.delays_ps = light.delays_ps(np.arange(light.count))
    if not own.all():
        at = photons.pulses[~own]
        block.extra_pairs = ExtraPairs(_made(layer, light, photons.chosen(~own), paulis[~own]), at)


def require_capacity(layer: PhysicalLayer, block: Block) -> None:
    """Refuse if the photons of weak pulses are too many to be drawn for all pulses."""
    if block.weak is not None:
        _require_capacity(layer, block, block.weak.count + block.weak.most_photons(1.0))


def _made(layer: PhysicalLayer, light: WeakPulses, photons: Photons, paulis: Bytes) -> Register:
    register = emission.prepare(layer.sabot, light.choices.states(photons.pulses))
    layer.sabot.pauli(register, paulis)
    return register


def _require_capacity(layer: PhysicalLayer, block: Block, photons: float) -> None:
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
    _require_capacity(layer, block, light.most_photons(best))
    photons = light.photons(best)
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
    register = _made(layer, light, photons, light.paulis(photons))
    draws = light.draws(photons, random)
    return layer.sabot.measure(register, bases(photons.pulses), draws)


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
    own = PhotonsByKey.of(random, identities(*photons)).normal("jitter") * jitter_ps
    return own if late is None else own + late
