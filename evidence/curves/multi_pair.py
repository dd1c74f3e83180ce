"""Both ends measure pulses of a source, with dark counts: how often their bits differ.

An end whose two detectors both click tells a random bit.
"""

import math

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

STATISTICS = Parameter("statistics", "poisson", choices=("poisson", "thermal", "single"))
MEAN = Parameter("mean_pairs", 0.1, 0.0, 10.0)
LOSS = Parameter("loss_db", 0.0, 0.0, 100.0, "dB")
FURTHER = Parameter("further_db", 0.0, 0.0, 100.0, "dB")  # of bob's way, beyond alice's
DARK = Parameter("dark_count", 0.0, 0.0, 0.5)  # of a detector, in a gate
WAYS = (("charlie-q0", "alice-q0"), ("charlie-q1", "bob-q0"))


async def compare(values: Values, seed: int) -> Outcome:
    """Send both halves of pulses over lossy ways; compare what the ends see in Z."""
    source = source_of(values)
    fibers = [fiber(*way, connectors_db=db) for way, db in zip(WAYS, losses(values), strict=True)]
    dark_count_hz = -math.log1p(-number(values, DARK.name)) / Detectors().gate_s
    ends = Device(detectors=Detectors(dark_count_hz=dark_count_hz))
    devices = {"charlie": Device(source=source), "alice": ends, "bob": ends}
    laboratory = Laboratory(configuration(seed, fibers, devices))
    charlie = laboratory.host("charlie")
    pulses = both = wrong = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        await charlie.create(size, block)
        await charlie.send({(block, half): way[0] for half, way in enumerate(WAYS)})
        seen = []
        for half, (name, way) in enumerate(zip(("alice", "bob"), WAYS, strict=True)):
            host = laboratory.host(name)
            came = await host.receive((block, half), way[1])
            none = np.full(size, NO_CLICK, np.uint8)
            seen.append(none if came is None else await host.measure((block, half)))
        coincident = (seen[0] != NO_CLICK) & (seen[1] != NO_CLICK)
        pulses, both = pulses + size, both + int(np.count_nonzero(coincident))
        wrong += int(np.count_nonzero(coincident & (seen[0] != seen[1])))
    return {"qber": proportion(wrong, both), "coincidences": proportion(both, pulses)}


def source_of(values: Values) -> PairSource:
    return PairSource(str(values[STATISTICS.name]), number(values, MEAN.name))


def losses(values: Values) -> tuple[float, float]:
    """Return what is lost on the way to alice and to bob (dB)."""
    loss_db = number(values, LOSS.name)
    return loss_db, loss_db + number(values, FURTHER.name)


def expected(values: Values) -> tuple[float, float]:
    """Return what theory says of the error rate and of how often both ends see something."""
    statistics = str(values[STATISTICS.name])
    to_alice, to_bob = (theory.transmission(each) for each in losses(values))
    ways, dark_count = (to_alice, to_bob), number(values, DARK.name)
    return theory.several_pairs(statistics, number(values, MEAN.name), ways, dark_count)


MULTI_PAIR = Experiment(
    "multi-pair",
    "errors by several pairs in a pulse",
    (STATISTICS, MEAN, LOSS, FURTHER, DARK, pairs_parameter(1_000_000)),
    (
        Measure("qber", "error rate (QBER)", lambda values: expected(values)[0]),
        Measure("coincidences", "pulses that both ends see", lambda values: expected(values)[1]),
    ),
    compare,
)
