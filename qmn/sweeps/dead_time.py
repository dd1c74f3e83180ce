"""Clicks of a detector with a dead time, from a train of pulses with one photon each."""

import math

import numpy as np

from dispatcher.laboratory import Laboratory
from qmn.sweeps import theory
from qmn.sweeps.estimates import ratio
from qmn.sweeps.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from qmn.sweeps.link import TESTED, configuration, fiber
from qmn.sweeps.parameters import Parameter, Values
from qmn.sweeps.superdense import blocks
from wire.dispatcher_pb2 import CreateRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device

EFFICIENCY = Parameter("efficiency", 1.0)
DEAD_TIME = Parameter("dead_time_s", 0.0, 0.0, 1.0, "s")
RATE = Parameter("rate_hz", 100_000_000, 1_000, 4_000_000_000, "Hz")
SAME_PULSE = 1e-9  # by which rounding may miss it


async def count(values: Values, seed: int) -> Outcome:
    """Count the clicks: all photons are in |0>, so that one detector sees them all."""
    detectors = Detectors(
        efficiency=number(values, EFFICIENCY.name), dead_time_s=number(values, DEAD_TIME.name)
    )
    devices = {"bob": Device(detectors=detectors)}
    laboratory = Laboratory(configuration(seed, [fiber(*TESTED)], devices))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    clicks, pulses = [], []
    for block, size in enumerate(blocks(int(values["pairs"]))):
        await alice.create(size, block, CreateRequest.ZEROS)
        await alice.send({(block, 0): TESTED[0]}, int(values[RATE.name]))
        await bob.receive((block, 0), TESTED[1])
        seen = await bob.measure((block, 0))
        clicks.append(int(np.count_nonzero(seen != NO_CLICK)))
        pulses.append(size)
        # What the detector did in this train is over when the next one comes.
        await laboratory.wait(number(values, DEAD_TIME.name))
    return {"clicks": ratio(clicks, pulses)}


def clicks(values: Values) -> float:
    """Return the theory of clicks."""
    intervals = number(values, DEAD_TIME.name) * number(values, RATE.name)
    blind = max(math.ceil(intervals - SAME_PULSE) - 1, 0)
    pulses = next(blocks(int(values["pairs"])))
    return theory.clicks_with_dead_time(number(values, EFFICIENCY.name), blind, pulses)


DEAD = Experiment(
    "dead-time",
    "clicks of a detector with a dead time",
    (EFFICIENCY, DEAD_TIME, RATE, pairs_parameter()),
    (Measure("clicks", "clicks per pulse", clicks),),
    count,
)
