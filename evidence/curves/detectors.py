"""Detectors: clicks with a dead time, and outcomes of blocks of one name."""

import math
from itertools import pairwise

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion, ratio
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.dispatcher_pb2 import CreateRequest, MeasureRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device

EFFICIENCY = Parameter("efficiency", 1.0)
DEAD_TIME = Parameter("dead_time_s", 0.0, 0.0, 1.0, "s")
RATE = Parameter("rate_hz", 100_000_000, 1_000, 4_000_000_000, "Hz")
SAME_PULSE = 1e-9  # by which rounding may miss it
USES = Parameter("uses", 2, 2, 1_000)
FAIR = 0.5


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
        # Effects on the detector end before the next train.
        await laboratory.wait(number(values, DEAD_TIME.name))
    return {"clicks": ratio(clicks, pulses)}


def clicks(values: Values) -> float:
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


async def use_again(values: Values, seed: int) -> Outcome:
    """Measure half of each pair in X; count how often two blocks in a row say the same."""
    alice = Laboratory(configuration(seed, [])).host("alice")
    uses = int(values[USES.name])
    size = int(values["pairs"]) // uses
    found = []
    for _ in range(uses):
        await alice.create(size)
        found.append(await alice.measure((0, 0), MeasureRequest.X))
        await alice.discard((0, 1))
    equal = sum(np.count_nonzero(a == b) for a, b in pairwise(found))
    return {"equal": proportion(int(equal), size * (uses - 1))}


FRESH_OUTCOMES = Experiment(
    "fresh-outcomes",
    "outcomes of blocks that have the same name, one after the other",
    (USES, pairs_parameter()),
    (Measure("equal", "how often two in a row are equal", lambda _values: FAIR),),
    use_again,
)
