"""Single photons of alice that bob measures: gates and dead times, polarisation, other light.

And a memory that reports which photons have come, and errs: it misses some, others never came.
"""

import math
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Bytes
from evidence.curves import theory
from evidence.curves.estimates import proportion, ratio
from evidence.curves.experiment import Outcome
from evidence.curves.link import TESTED, blocks, fiber, network, optics_of
from evidence.curves.parameters import Point
from evidence.laboratory import RATE_HZ, Laboratory
from wire.dispatcher_pb2 import CreateRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, Memory, PairSource

DISPERSION = 17.0  # ps/(nm km), as standard fibre has
SLOW_HZ = 100_000  # pulses so far apart that none comes into the gate of another
SAME_PULSE = 1e-9  # by which rounding may miss it
TURNS_S = 1e-9  # each photon meets a turn of its own: the mean over all turns
STATES = "zxy"  # bases, of two states each

Theory = dict[str, float]


async def zeros(laboratory: Laboratory, pulses: float, rate_hz: float) -> AsyncIterator[Bytes]:
    """Send photons in |0>; yield what bob sees of each block in Z."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    for block, size in blocks(pulses):
        await alice.create(size, block, CreateRequest.ZEROS)
        await alice.send({(block, 0): TESTED[0]}, int(rate_hz))
        if await bob.receive((block, 0), TESTED[1]) is None:
            yield np.full(size, NO_CLICK, np.uint8)
        else:
            yield await bob.measure((block, 0))


async def timing(v: Point, seed: int) -> Outcome:
    """Count what a detector sees of single photons behind a fibre."""
    detectors = Detectors(jitter_ps=v.jitter_ps, gate_s=v.gate_s)
    way = fiber(*TESTED, length_km=v.length_km, dispersion_ps_per_nm_km=DISPERSION)
    alice = Device(PairSource(bandwidth_nm=v.bandwidth_nm))
    laboratory = network(seed, [way], alice=alice, bob=Device(detectors=detectors))
    seen = [(bits != NO_CLICK, bits.size) async for bits in zeros(laboratory, v.pairs, SLOW_HZ)]
    return {"counted": proportion(*(int(np.sum(each)) for each in zip(*seen, strict=True)))}


def timed(v: Point) -> Theory:
    rms_ps = math.hypot(DISPERSION * v.length_km * v.bandwidth_nm, v.jitter_ps)
    return {"counted": theory.within_gate(rms_ps * 1e-12, v.gate_s)}


async def dead_time(v: Point, seed: int) -> Outcome:
    """Count the clicks: all photons are in |0>, so that one detector sees them all."""
    detectors = Detectors(efficiency=v.efficiency, dead_time_s=v.dead_time_s)
    laboratory = network(seed, [fiber(*TESTED)], bob=Device(detectors=detectors))
    clicks, pulses = [], []
    async for bits in zeros(laboratory, v.pairs, v.rate_hz):
        clicks.append(int(np.count_nonzero(bits != NO_CLICK)))
        pulses.append(bits.size)
        await laboratory.wait(v.dead_time_s)  # the next train meets a detector that is awake
    return {"clicks": ratio(clicks, pulses)}


def clicks(v: Point) -> Theory:
    blind = max(math.ceil(v.dead_time_s * v.rate_hz - SAME_PULSE) - 1, 0)
    _number, pulses = next(blocks(v.pairs))
    return {"clicks": theory.clicks_with_dead_time(v.efficiency, blind, pulses)}


async def classical_light(v: Point, seed: int) -> Outcome:
    settings: dict[str, Any] = {name: value for name, value in v.items() if name != "pairs"}
    laboratory = network(seed, [fiber(*TESTED, **settings)])
    pulses = seen = wrong = 0
    async for bits in zeros(laboratory, v.pairs, RATE_HZ):
        pulses += bits.size
        seen += int(np.count_nonzero(bits != NO_CLICK))
        wrong += int(np.count_nonzero(bits == 1))
    return {"gain": proportion(seen, pulses), "qber": proportion(wrong, seen)}


def beside_classical_light(v: Point) -> Theory:
    against = v["classical_way"] == "against"
    numbers = {k: float(each) for k, each in v.items() if k not in ("classical_way", "pairs")}
    noise = theory.scattered_photons(**numbers, against=against)
    arrives = theory.transmission(v.loss_db_per_km * v.length_km)
    dark = math.exp(-noise / 2)  # in either detector
    seen = 1 - (1 - arrives) * dark**2
    both = (1 - dark) * (1 - (1 - arrives) * dark)
    return {"gain": seen, "qber": ((1 - arrives) * dark * (1 - dark) + both / 2) / seen}


async def turned(v: Point, seed: int) -> Outcome:
    wrong, came, _sent = await behind(v, seed)
    return {basis: proportion(int(wrong[i]), int(came[i])) for i, basis in enumerate(STATES)}


async def modes(v: Point, seed: int) -> Outcome:
    wrong, came, sent = await behind(v, seed)
    errors = proportion(int(wrong.sum()), int(came.sum()))
    return {"error": errors, "arrived": proportion(int(came.sum()), sent)}


async def behind(v: Point, seed: int) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return how many were wrong, and how many came, of each basis, and how many were sent."""
    way = fiber(*TESTED, **optics_of(v), polarization_drift_time_s=TURNS_S)
    source = PairSource(bandwidth_nm=float(v.get("bandwidth_nm", 0.0)))
    laboratory = network(seed, [way], alice=Device(source))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    wrong, came = np.zeros((2, len(STATES)), np.int64)
    sent = 0
    for block, size in blocks(v.pairs):
        states = (np.arange(size) % (2 * len(STATES))).astype(np.uint8)
        await alice.prepare(states, block)
        await alice.send({(block, 0): TESTED[0]})
        await bob.receive((block, 0), TESTED[1])
        bits = await bob.measure((block, 0), bases=states >> np.uint8(1))
        sent, there = sent + size, bits != NO_CLICK
        bases, errors = states[there] >> 1, (bits ^ states)[there] & np.uint8(1)
        wrong += np.bincount(bases, errors, len(STATES)).astype(np.int64)
        came += np.bincount(bases, minlength=len(STATES))
    return wrong, came, sent


def turns(v: Point) -> Theory:
    rms_rad = v.polarization_drift_rad_per_sqrt_km * math.sqrt(v.length_km)
    return dict.fromkeys(STATES, theory.birefringence_error(rms_rad))


def of_modes(v: Point) -> Theory:
    """Return errors in any basis behind loss and delay, which compose, and what comes through."""
    mean_s = v.pmd_ps_per_sqrt_km * math.sqrt(v.length_km) * 1e-12
    correlation = (1 - 2 * theory.dependent_loss_error(v.pdl_db)) * (
        1 - 2 * theory.mode_dispersion_error(mean_s, theory.rad_per_s(v.bandwidth_nm))
    )
    return {"error": (1 - correlation) / 2, "arrived": (1 + theory.transmission(v.pdl_db)) / 2}


async def stored(v: Point, seed: int) -> Outcome:
    """Store photons that arrive; count those that are heralded, and of these those there."""
    memory = Memory(herald_efficiency=v.herald_efficiency, false_herald=v.false_herald)
    way = fiber(*TESTED, connectors_db=v.loss_db)
    laboratory = network(seed, [way], alice=Device(), bob=Device(memory=memory))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    sent = heralded = there = 0
    for block, size in blocks(v.pairs):
        await alice.create(size, block)
        await alice.send({(block, 1): TESTED[0]})
        sent += size
        if await bob.receive((block, 1), TESTED[1]) is None:
            continue
        heralds = np.frombuffer((await bob.store((block, 1))).arrived, np.uint8) > 0
        outcomes = await bob.measure((block, 1))
        heralded += int(np.count_nonzero(heralds))
        there += int(np.count_nonzero(heralds & (outcomes != NO_CLICK)))
    return {"heralded": proportion(heralded, sent), "there": proportion(there, heralded)}


def heralds(v: Point) -> Theory:
    passes = theory.transmission(v.loss_db)
    right, false = passes * v.herald_efficiency, (1 - passes) * v.false_herald
    return {"heralded": right + false, "there": right / (right + false)}
