"""Bell measurements under the dispatcher's physics: CHSH, and ways that differ in length.

The CHSH test: S of Werner pairs at the angles that suit Phi+ best (0, 90 and 45, -45 degrees).

The angles are not Clifford gates: state vectors simulate this. Noise is made as in
teleportation: half of a perfect pair passes a fibre that depolarises with p = 4 (1 - F)/3.
"""

from math import pi

import numpy as np

from dispatcher.laboratory import Laboratory, LaboratoryHost
from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import PLAIN, TESTED, configuration, fiber, link
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from evidence.curves.teleportation import FIDELITY
from wire.dispatcher_pb2 import Gate
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Device

# Angle of alice, angle of bob, and the sign of their correlation in S.
SETTINGS = ((0, pi / 4, 1), (0, -pi / 4, 1), (pi / 2, pi / 4, 1), (pi / 2, -pi / 4, -1))
DIFFERENCE = Parameter("difference_km", 0.0, 0.0, 1_999.0, "km")
LOSS = Parameter("delay_line_db_per_km", 0.2, 0.0, 1_000.0, "dB/km")


async def chsh(values: Values, seed: int) -> Outcome:
    laboratory = link({"depolarizing": theory.of_fidelity(number(values, "fidelity"))}, seed)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    each = int(values["pairs"]) // len(SETTINGS)
    s, variance = 0.0, 0.0
    for block, (mine, yours, sign) in enumerate(SETTINGS):
        agreeing = await correlate(alice, bob, block, each, (mine, yours))
        s += sign * (2 * agreeing.value - 1)
        variance += (2 * agreeing.error) ** 2
    return {"chsh": Estimate(s, variance**0.5)}


async def correlate(
    alice: LaboratoryHost, bob: LaboratoryHost, block: int, pairs: int, angles: tuple[float, float]
) -> Estimate:
    """Return how often both see the same when each measures along an angle from Z towards X."""
    await alice.create(pairs, block)
    await alice.send({(block, 1): TESTED[0]})
    await bob.receive((block, 1), TESTED[1])
    for host, half, angle in ((alice, 0, angles[0]), (bob, 1, angles[1])):
        await host.apply((block, half), gates=[Gate(name=Gate.RY, angle_rad=-angle)])
    outcomes = await alice.measure((block, 0)), await bob.measure((block, 1))
    return proportion(int(np.count_nonzero(outcomes[0] == outcomes[1])), pairs)


CHSH = Experiment(
    "chsh",
    "the CHSH test with Werner pairs",
    (FIDELITY, pairs_parameter()),
    (Measure("chsh", "S", lambda values: theory.chsh(number(values, "fidelity"))),),
    chsh,
)


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
        outcomes = await bob.bell_measure((block, 0), (block, 1))
        seen, pairs = seen + int(np.count_nonzero(outcomes != NO_CLICK)), pairs + size
    return {"coincidences": proportion(seen, pairs)}


def expected(values: Values) -> float:
    return theory.transmission(number(values, LOSS.name) * number(values, DIFFERENCE.name))


DELAY_LINE = Experiment(
    "delay-line",
    "a Bell measurement of halves whose ways differ",
    (DIFFERENCE, LOSS, pairs_parameter()),
    (Measure("coincidences", "pairs that give a coincidence", expected),),
    meet,
)
