"""Light out of a memory comes when it is wanted: nothing is left of how it came; 5 sigma."""

from math import erf, sqrt
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within

from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Detectors, Device, PairSource

COUNT = 100_000
GATE_S = 1e-9
IN_GATE = erf(0.5 / sqrt(2))  # of a normal error whose rms is the width of the gate


def laboratory(source: PairSource, bob: Device, **fiber: Any) -> Laboratory:
    """Return charlie, who has a source, and two fibres from him to bob."""
    ends = [(FiberEnd("charlie", f"charlie-q{n}"), FiberEnd("bob", f"bob-q{n}")) for n in (0, 1)]
    fibers = [Fiber(*way, **fiber) for way in ends]
    config = DispatcherConfig("", "", 1, dict.fromkeys(("charlie", "bob"), ""), fibers, [])
    config.devices.update(charlie=Device(source=source), bob=bob)
    return Laboratory(config)


@pytest.mark.parametrize(("stored", "counted"), [(False, IN_GATE), (True, 1.0)])
@pytest.mark.parametrize(
    ("source", "fiber"),
    [
        (PairSource(jitter_ps=1000), {}),
        (PairSource(bandwidth_nm=1), {"dispersion_ps_per_nm_km": 100, "length_km": 10}),
    ],
    ids=["jitter", "dispersion"],
)
def test_light_out_of_a_memory_comes_within_the_gate(
    source: PairSource, fiber: dict[str, float], stored: bool, counted: float
) -> None:
    """Both spread light by as much as the gate of 1 ns is wide: 1000 ps, and 1 nm 100 ps/nm/km."""

    async def run() -> None:
        here = laboratory(source, Device(detectors=Detectors(gate_s=GATE_S)), **fiber)
        charlie, bob = here.host("charlie"), here.host("bob")
        await charlie.create(COUNT)
        await charlie.send({(0, 1): "charlie-q0"}, 1_000_000)
        await bob.receive((0, 1), "bob-q0")
        if stored:
            await bob.store((0, 1))
            await here.wait(0.3)
        seen = int(np.count_nonzero(await bob.measure((0, 1)) != NO_CLICK))
        assert within(seen, COUNT, counted)

    uvloop.run(run())


@pytest.mark.parametrize("stored", [False, True])
def test_photons_out_of_memories_interfere_as_if_they_had_no_jitter(stored: bool) -> None:
    """Else V is the mean of exp(-(s tau)^2) over a normal tau of variance 2 j^2:

    1 / sqrt(1 + 4 (s j)^2), and the phase flips with (1 - V) / 2: .2764 where s j = 1.
    """
    width_rad_per_s, jitter_s = 1e12, 1e-12
    visibility = 1.0 if stored else 1 / sqrt(1 + 4 * (width_rad_per_s * jitter_s) ** 2)

    async def run() -> None:
        analyser = BellAnalyser(bandwidth_rad_per_s=width_rad_per_s)
        here = laboratory(PairSource(jitter_ps=jitter_s * 1e12), Device(analyser=analyser))
        charlie, bob = here.host("charlie"), here.host("bob")
        for number in (0, 1):
            await charlie.create(COUNT, number)
        await charlie.send({(0, 1): "charlie-q0", (1, 1): "charlie-q1"})
        for number in (0, 1):
            await bob.receive((number, 1), f"bob-q{number}")
            if stored:
                await bob.store((number, 1))
        outcomes = await bob.bell_measure((0, 1), (1, 1))
        # Halves of two Phi+ are found in the same Bell state as the other two.
        flips = outcomes ^ await charlie.bell_measure((0, 0), (1, 0))
        assert set(flips.tolist()) <= {0, 2}
        assert within(int(np.count_nonzero(flips)), COUNT, (1 - visibility) / 2)

    uvloop.run(run())
