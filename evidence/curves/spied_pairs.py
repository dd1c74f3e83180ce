"""E91 with an eavesdropper who measures a fraction of the photons in Z or X: S and error rate."""

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from evidence.curves.teleportation import FIDELITY
from hosts.hardware.qnic import LEFT_ALONE
from hosts.middleware.qkd.bell_test import Correlations
from wire.outcomes import PAULI_BASES

FRACTION = Parameter("fraction", 0.0, 0.0, 1.0)
TO_EVE, TO_BOB = ("alice-q0", "eve-q0"), ("eve-q1", "bob-q0")


async def compare(values: Values, seed: int) -> Outcome:
    """Keep half of each pair at alice, send the other past eve, and measure both as E91 does."""
    noise = theory.of_fidelity(number(values, FIDELITY.name))
    fibers = [fiber(*TO_EVE, depolarizing=noise), fiber(*TO_BOB)]
    laboratory = Laboratory(configuration(seed, fibers))
    alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
    random, fraction = np.random.default_rng(seed), number(values, FRACTION.name)
    bell, wrong, sifted = Correlations(), 0, 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        hers, his, eves = random.integers(0, 2, (3, size), dtype=np.uint8)
        tested = random.random(size) < 1 / 2
        await alice.create(size, block)
        await alice.send({(block, 1): TO_EVE[0]})
        await eve.receive((block, 1), TO_EVE[1])
        taken = random.random(size) < fraction
        await eve.resend((block, 1), np.where(taken, eves, LEFT_ALONE).astype(np.uint8))
        await eve.send({(block, 1): TO_BOB[0]})
        await bob.receive((block, 1), TO_BOB[1])
        bases = np.where(tested, his + PAULI_BASES, his).astype(np.uint8)
        differ = await bob.measure((block, 1), bases=bases)
        differ = differ ^ await alice.measure((block, 0), bases=hers)
        bell.add(hers[tested], his[tested], differ[tested])
        same = ~tested & (hers == his)
        sifted, wrong = sifted + int(same.sum()), wrong + int(differ[same].sum())
    return {"chsh": Estimate(bell.s, bell.error), "qber": proportion(wrong, sifted)}


def _kept(values: Values) -> float:
    return 1 - number(values, FRACTION.name) / 2


SPIED_PAIRS = Experiment(
    "spied-pairs",
    "E91 with an eavesdropper who measures and resends",
    (FRACTION, FIDELITY, pairs_parameter()),
    (
        Measure(
            "chsh", "S", lambda values: _kept(values) * theory.chsh(number(values, FIDELITY.name))
        ),
        Measure(
            "qber",
            "error rate (QBER)",
            lambda values: (1 - _kept(values) * (4 * number(values, FIDELITY.name) - 1) / 3) / 2,
        ),
    ),
    compare,
)
