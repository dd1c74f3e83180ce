"""Light of the shorter way waits for the other: 10^(-dB / 10) of it is left; 5 sigma, seed 1."""

import asyncio

import numpy as np
import pytest
from five_sigma import within

from dispatcher.laboratory import Laboratory
from dispatcher.sabot.backend import Bytes
from wire.config import DispatcherConfig, Fiber, FiberEnd
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Device

COUNT = 100_000


async def told(
    db_per_km: float, stored: bool, lengths_km: tuple[float, float]
) -> tuple[Bytes, Laboratory]:
    """Return the outcomes of Phi+ whose halves go these ways to bob, and the laboratory."""
    fibers = [
        Fiber(FiberEnd("alice", f"alice-q{i}"), FiberEnd("bob", f"bob-q{i}"), length_km=length_km)
        for i, length_km in enumerate(lengths_km)
    ]
    devices = {
        "alice": Device(),
        "bob": Device(analyser=BellAnalyser(delay_line_db_per_km=db_per_km)),
    }
    tokens = dict.fromkeys(devices, "")
    config = DispatcherConfig("", "", 1, tokens, fibers, [], devices=devices)
    laboratory = Laboratory(config)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(COUNT)
    await alice.send({(0, 0): "alice-q0", (0, 1): "alice-q1"})
    for half in (0, 1):
        await bob.receive((0, half), f"bob-q{half}")
        if stored:
            await bob.store((0, half))
    return await bob.bell_measure((0, 0), (0, 1)), laboratory


@pytest.mark.parametrize(
    ("db_per_km", "stored", "lengths_km", "loss_db"),
    [
        (0.2, False, (1.0, 11.0), 2.0),
        (0.2, False, (11.0, 1.0), 2.0),
        (0.2, False, (5.0, 5.0), 0.0),
        (0.0, False, (1.0, 2_000.0), 0.0),
        (0.2, True, (1.0, 11.0), 0.0),
    ],
)
def test_so_much_fibre_as_the_ways_differ_by_costs_light(
    db_per_km: float, stored: bool, lengths_km: tuple[float, float], loss_db: float
) -> None:
    found, laboratory = asyncio.run(told(db_per_km, stored, lengths_km))
    seen = int(np.count_nonzero(found != NO_CLICK))
    assert within(seen, COUNT, 10 ** (-loss_db / 10))
    assert not found[found != NO_CLICK].any()
    assert laboratory.layer.photons_lost == COUNT - seen


def test_two_thousand_kilometres_leave_nothing() -> None:
    found, _laboratory = asyncio.run(told(0.2, False, (0.0, 2_000.0)))
    assert (found == NO_CLICK).all()
