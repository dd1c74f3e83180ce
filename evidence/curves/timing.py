"""Single photons that come too early or too late for the gate of their detector.

Pulses are so far apart that none comes into the gate of another.
"""

import math

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.dispatcher_pb2 import CreateRequest
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors, Device, PairSource

JITTER = Parameter("jitter_ps", 0.0, 0.0, 1e5, "ps")
GATE = Parameter("gate_s", 1e-9, 1e-12, 1e-6, "s")
LENGTH = Parameter("length_km", 0.0, 0.0, 100.0, "km")
BANDWIDTH = Parameter("bandwidth_nm", 0.0, 0.0, 100.0, "nm")
DISPERSION = 17.0  # ps/(nm km), as standard fibre has
RATE_HZ = 100_000


async def count(values: Values, seed: int) -> Outcome:
    """Count what a detector sees of single photons behind a fibre."""
    source = PairSource(bandwidth_nm=number(values, BANDWIDTH.name))
    gate_s, jitter_ps = number(values, GATE.name), number(values, JITTER.name)
    devices = {
        "alice": Device(source),
        "bob": Device(detectors=Detectors(jitter_ps=jitter_ps, gate_s=gate_s)),
    }
    length_km = number(values, LENGTH.name)
    way = fiber(*TESTED, length_km=length_km, dispersion_ps_per_nm_km=DISPERSION)
    laboratory = Laboratory(configuration(seed, [way], devices))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    seen = pulses = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        await alice.create(size, block, CreateRequest.ZEROS)
        await alice.send({(block, 0): TESTED[0]}, RATE_HZ)
        await bob.receive((block, 0), TESTED[1])
        seen += int(np.count_nonzero(await bob.measure((block, 0)) != NO_CLICK))
        pulses += size
    return {"counted": proportion(seen, pulses)}


def expected(values: Values) -> float:
    spread_ps = DISPERSION * number(values, LENGTH.name) * number(values, BANDWIDTH.name)
    rms_ps = math.hypot(spread_ps, number(values, JITTER.name))
    return theory.within_gate(rms_ps * 1e-12, number(values, GATE.name))


TIMING = Experiment(
    "timing",
    "single photons and the gate of their detector",
    (JITTER, GATE, LENGTH, BANDWIDTH, pairs_parameter()),
    (Measure("counted", "photons that are counted", expected),),
    count,
)
