"""When single photons are counted, and in which slot, against the normal distribution; 5 sigma."""

from math import erf, sqrt
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within

from dispatcher.layer.ownership import BlockName
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

COUNT, EACH = 200_000, 50  # slots, and how far pulses with light are apart
RATE_HZ = 1_000_000_000
INTERVAL_PS = 1e12 / RATE_HZ

IDEAL = PairSource()


def counted(slot: int, sigma_ps: float, gate_ps: float) -> float:
    """Return how likely a normal error of this rms falls into the gate of a slot."""
    ends = [(slot * INTERVAL_PS + side * gate_ps / 2) / (sigma_ps * sqrt(2)) for side in (-1, 1)]
    return (erf(ends[1]) - erf(ends[0])) / 2


def slots_of(
    detectors: Detectors, source: PairSource = IDEAL, fibers: int = 1, **fiber: Any
) -> np.ndarray:
    """Return how many clicks are counted in each slot around those with light, -25 to 24."""

    async def run() -> np.ndarray:
        ends = [FiberEnd(host, f"{host}-q0") for host in ("alice", "bob")]
        devices = {"alice": Device(source), "bob": Device(detectors=detectors)}
        config = DispatcherConfig(
            "", "", 1, dict.fromkeys(devices, ""), [Fiber(*ends, **fiber)], []
        )
        config.devices.update(devices)
        laboratory = Laboratory(config)
        alice, bob = laboratory.host("alice"), laboratory.host("bob")
        await alice.prepare(np.zeros(COUNT, np.uint8))
        (block,) = laboratory.layer.ownership.parts(BlockName(1, 0, 0))
        laboratory.layer.sabot.lose(block.register, np.arange(COUNT) % EACH != EACH // 2)
        for way in range(fibers):
            giver, taker = ((alice, bob), (bob, alice))[way % 2]
            await giver.send({(0, 0): f"{giver.name}-q0"}, RATE_HZ)
            await taker.receive((0, 0), f"{taker.name}-q0")
        clicked = np.flatnonzero(await bob.measure((0, 0)) != NO_CLICK)
        return np.bincount(clicked % EACH, minlength=EACH)

    return uvloop.run(run())


def agree(found: np.ndarray, sigma_ps: float, gate_ps: float) -> bool:
    """Return whether slots are as full as they should be."""
    pulses = COUNT // EACH
    return all(
        within(int(clicks), pulses, counted(slot - EACH // 2, sigma_ps, gate_ps))
        for slot, clicks in enumerate(found)
    )


@pytest.mark.parametrize(
    ("jitter_ps", "gate_ps"), [(200, 1000), (900, 1000), (900, 400), (50, 100)]
)
def test_the_jitter_of_a_detector_decides_about_slot_and_count(
    jitter_ps: float, gate_ps: float
) -> None:
    assert agree(
        slots_of(Detectors(jitter_ps=jitter_ps, gate_s=gate_ps * 1e-12)), jitter_ps, gate_ps
    )


def test_jitter_of_a_microsecond_leaves_a_tenth_in_gates_of_a_tenth_of_the_time() -> None:
    """And of that nothing where it belongs: a thousand slots are as likely."""
    found = slots_of(Detectors(jitter_ps=1e6, gate_s=1e-10))
    assert within(int(found.sum()), COUNT // EACH, 0.1)
    assert within(int(found[EACH // 2]), COUNT // EACH, 0.1 / EACH)


def test_the_jitters_of_source_and_detector_add_up() -> None:
    found = slots_of(Detectors(jitter_ps=300, gate_s=1e-9), PairSource(jitter_ps=400))
    assert agree(found, 500, 1000)


@pytest.mark.parametrize("fibers", [1, 3])
def test_dispersion_spreads_light_of_some_bandwidth_as_far_as_it_goes(fibers: int) -> None:
    """17 ps/(nm km), 10 km, .5 nm: 85 ps, and three times that after three ways."""
    source = PairSource(bandwidth_nm=0.5)
    fiber = {"length_km": 10.0, "dispersion_ps_per_nm_km": 17.0}
    found = slots_of(Detectors(gate_s=1e-10), source, fibers, **fiber)
    assert agree(found, 85.0 * fibers, 100.0)


def test_dark_counts_come_with_the_gate() -> None:
    """Of gates of .4 ns at 1e8 / s, 4 %, by either detector."""
    found = slots_of(Detectors(dark_count_hz=1e8, gate_s=4e-10, efficiency=1e-9))
    dark = 1 - np.exp(-2 * 1e8 * 4e-10)
    assert within(int(found.sum()), COUNT, float(dark))
