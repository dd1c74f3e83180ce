"""Pairs that wait in memories after a sample of them was measured, until they are handed over.

The sample's estimate is given as measured, and as expected at delivery.
"""

import math

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from hosts.middleware.services.distribution.fidelity import Estimate as Sampled
from hosts.middleware.session.values import Lifetimes
from wire.parameters.physics import Device, Memory, PairSource

WAIT = Parameter("waited_s", 0.05, 0.0, 10.0, "s")
FIDELITY = Parameter("fidelity", 0.95, 0.25, 1.0)
T1, T2 = Parameter("t1_s", 0.2, 1e-6, math.inf, "s"), Parameter("t2_s", 0.1, 1e-6, math.inf, "s")
BLOCK = 3_000  # pairs, of 3 us: the first has not waited for the last


async def deliver(values: Values, seed: int) -> Outcome:
    """Measure every other block at once, and those that are handed over when they have waited."""
    memory = Memory(t1_s=number(values, T1.name), t2_s=number(values, T2.name))
    devices = {
        "alice": Device(source=PairSource(fidelity=number(values, FIDELITY.name)), memory=memory),
        "bob": Device(memory=memory),
    }
    laboratory = Laboratory(configuration(seed, [fiber(*TESTED, length_km=0.0)], devices))
    sampled, found, waited_s = Sampled(), Sampled(), number(values, WAIT.name)
    for block in range(int(values["pairs"]) // BLOCK):
        await _share(laboratory, block)
        if block % 2:
            await laboratory.wait(waited_s)
        await _measure(laboratory, block, found if block % 2 else sampled)
    like = Lifetimes(memory.t1_s, memory.t2_s, memory.depolarizing_s, memory.cutoff_s)
    return {
        "estimate": Estimate(sampled.fidelity or math.nan, _error(sampled)),
        "expected": Estimate(sampled.after(waited_s, (like, like)) or math.nan, _error(sampled)),
        "delivered": Estimate(found.fidelity or math.nan, _error(found)),
    }


async def _share(laboratory: Laboratory, block: int) -> None:
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    await alice.create(BLOCK, block)
    await alice.store((block, 0))
    await alice.send({(block, 1): TESTED[0]})
    await bob.receive((block, 1), TESTED[1])
    await bob.store((block, 1))


async def _measure(laboratory: Laboratory, block: int, found: Sampled) -> None:
    bases = (np.arange(BLOCK) % 3).astype(np.uint8)
    mine, yours = [
        await laboratory.host(host).measure((block, half), bases=bases)
        for half, host in enumerate(("alice", "bob"))
    ]
    found.add(bases, mine, yours)


def _error(found: Sampled) -> float:
    """Return the standard error of a fidelity, the sum of three shares of a half each."""
    shares = [proportion(int(r), int(n)) for r, n in zip(found.right, found.measured, strict=True)]
    return math.hypot(*(share.error for share in shares)) / 2


def at_first(values: Values) -> float:
    """Return the fidelity of the source."""
    return number(values, FIDELITY.name)


def at_delivery(values: Values) -> float:
    """Return that of Werner pairs both halves of which have waited: coherence and relaxation."""
    waited_s, werner = number(values, WAIT.name), (4 * number(values, FIDELITY.name) - 1) / 3
    coherent = math.exp(-2 * waited_s / number(values, T2.name))
    excited = math.exp(-waited_s / number(values, T1.name))
    in_z = excited**2 * werner + (1 - excited) ** 2
    return (1 + 2 * coherent * werner + in_z) / 4


HANDED_OVER = Experiment(
    "handed-over",
    "fidelity of pairs when they are handed over, and what a sample says of it",
    (WAIT, FIDELITY, T1, T2, pairs_parameter(300_000)),
    (
        Measure("estimate", "fidelity of the sample", at_first),
        Measure("expected", "fidelity expected at delivery", at_delivery),
        Measure("delivered", "fidelity at delivery", at_delivery),
    ),
    deliver,
)
