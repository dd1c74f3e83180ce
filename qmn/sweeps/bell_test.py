"""The CHSH test: S of Werner pairs at the angles that suit Phi+ best (0, 90 and 45, -45 degrees).

The angles are not Clifford gates: state vectors simulate this. Noise is made as in
teleportation: half of a perfect pair passes a fibre that depolarises with p = 4 (1 - F)/3.
"""

from math import pi

import numpy as np

from dispatcher.laboratory import LaboratoryHost
from qmn.sweeps import theory
from qmn.sweeps.estimates import Estimate, proportion
from qmn.sweeps.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from qmn.sweeps.link import TESTED, link
from qmn.sweeps.parameters import Values
from qmn.sweeps.teleportation import FIDELITY
from wire.dispatcher_pb2 import Gate

# Angle of alice, angle of bob, and the sign of their correlation in S.
SETTINGS = ((0, pi / 4, 1), (0, -pi / 4, 1), (pi / 2, pi / 4, 1), (pi / 2, -pi / 4, -1))


async def chsh(values: Values, seed: int) -> Outcome:
    """Measure the four correlations with equally many pairs."""
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
