"""Weak pulses, of which only those are simulated that may click; the seeds are 1 to 50."""

from dataclasses import replace

import numpy as np
import pytest
import uvloop

from dispatcher.laboratory import Laboratory
from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import Block
from dispatcher.layer.weak_pulses import Photons, WeakPulses
from dispatcher.operations import weak_light
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

SEEDS = range(1, 51)
PULSES = 10_000


def every_photon(light: WeakPulses, _share: float = 1.0) -> Photons:
    """Return all photons that have left the source, whatever becomes of them."""
    return light._below(1.0)


def nothing_weak(_layer: PhysicalLayer, why: str, *blocks: Block) -> None:
    assert all(block.weak is None for block in blocks), why


def chosen(random: np.random.Generator) -> tuple[DispatcherConfig, int]:
    """Return a network with a switch between alice and bob, and its rate; all of it at random."""

    def some(least: float, most: float) -> float:
        return float(random.choice([least, random.uniform(least, most)]))

    means = sorted(random.uniform(0, 0.5, 2), reverse=True)
    source = PairSource(
        "poisson",
        mean_pairs=float(sum(means) + random.uniform(0.01, 2)),
        decoys=(means[0], means[1]),
        jitter_ps=some(0, 400),
        preparation_error=some(0, 0.2),
        bandwidth_nm=some(0, 1),
    )
    detectors = Detectors(
        efficiency=random.uniform(0.05, 1),
        efficiency_mismatch=some(0, 0.6),
        dark_count_hz=some(0, 1e7),
        gate_s=random.uniform(0.2e-9, 1e-9),
        dead_time_s=some(0, 2e-7),
        afterpulse_probability=some(0, 0.3),
        jitter_ps=some(0, 300),
        readout_error=some(0, 0.1),
    )
    fiber = Fiber(
        FiberEnd("alice", "alice-q0"),
        FiberEnd("q1", "1"),
        length_km=random.uniform(0.1, 20),
        loss_db_per_km=some(0, 1),
        connectors_db=some(0, 5),
        depolarizing=some(0, 0.3),
        dephasing=some(0, 0.3),
        pauli_x=some(0, 0.1),
        pauli_y=some(0, 0.1),
    )
    second = replace(fiber, a=FiberEnd("q1", "2"), b=FiberEnd("bob", "bob-q0"))
    switch = QuantumSwitch("q1", insertion_loss_db=some(0, 3), rotation=int(random.integers(4)))
    devices = {"alice": Device(source), "bob": Device(detectors=detectors)}
    tokens, seed = dict.fromkeys(devices, ""), int(random.integers(1 << 30))
    fibers = [fiber, second]
    config = DispatcherConfig("", "", seed, tokens, fibers, [switch], devices=devices)
    return config, int(random.choice([100_000_000, 1_000_000_000]))


async def exchanged(config: DispatcherConfig, rate_hz: int, pulses: int = PULSES) -> list[int]:
    """Return bob's outcomes of two blocks."""
    random, laboratory = np.random.default_rng(config.seed), Laboratory(config)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await laboratory.connect("q1", {1: 2})
    seen = list[int]()
    for number in range(2):
        states = random.integers(0, 6, pulses, dtype=np.uint8)
        bases = random.integers(0, 3, pulses, dtype=np.uint8)
        levels = random.integers(0, 3, pulses, dtype=np.uint8)
        await alice.prepare(states, number, levels)
        await alice.send({(number, 0): "alice-q0"}, rate_hz)
        await bob.receive((number, 0), "bob-q0")
        seen += (await bob.measure((number, 0), bases=bases)).tolist()
    return seen


@pytest.mark.parametrize("seed", SEEDS)
def test_what_clicks_is_the_same_if_every_photon_is_simulated(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, rate_hz = chosen(np.random.default_rng(seed))
    monkeypatch.setattr(weak_light, "draw", nothing_weak)
    sparse = uvloop.run(exchanged(config, rate_hz))
    assert set(sparse) > {NO_CLICK}
    monkeypatch.setattr(WeakPulses, "photons", every_photon)
    assert uvloop.run(exchanged(config, rate_hz)) == sparse
