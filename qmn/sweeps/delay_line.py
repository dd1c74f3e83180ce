"""A Bell measurement of halves whose ways differ: the earlier one waits in a delay line."""

import numpy as np

from dispatcher.laboratory import Laboratory
from qmn.sweeps import theory
from qmn.sweeps.estimates import proportion
from qmn.sweeps.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from qmn.sweeps.link import PLAIN, TESTED, configuration, fiber
from qmn.sweeps.parameters import Parameter, Values
from qmn.sweeps.superdense import blocks
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Device

DIFFERENCE = Parameter("difference_km", 0.0, 0.0, 1_999.0, "km")
LOSS = Parameter("delay_line_db_per_km", 0.2, 0.0, 1_000.0, "dB/km")


async def meet(values: Values, seed: int) -> Outcome:
    """Send both halves of pairs over lossless ways, and count coincidences."""
    longer = fiber(*TESTED, length_km=1.0 + number(values, DIFFERENCE.name))
    fibers = [longer, fiber(*PLAIN, length_km=1.0)]
    analyser = BellAnalyser(delay_line_db_per_km=number(values, LOSS.name))
    laboratory = Laboratory(configuration(seed, fibers, {"bob": Device(analyser=analyser)}))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    seen = pairs = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        ways = dict(enumerate((TESTED, PLAIN)))
        await alice.create(size, block)
        await alice.send({(block, half): way[0] for half, way in ways.items()})
        for half, way in ways.items():
            await bob.receive((block, half), way[1])
        told = await bob.bell_measure((block, 0), (block, 1))
        seen, pairs = seen + int(np.count_nonzero(told != NO_CLICK)), pairs + size
    return {"coincidences": proportion(seen, pairs)}


def expected(values: Values) -> float:
    """Return which part of the earlier light comes through its delay line."""
    return theory.transmission(number(values, LOSS.name) * number(values, DIFFERENCE.name))


DELAY_LINE = Experiment(
    "delay-line",
    "a Bell measurement of halves whose ways differ",
    (DIFFERENCE, LOSS, pairs_parameter()),
    (Measure("coincidences", "pairs that give a coincidence", expected),),
    meet,
)
