"""A memory that tells which photons have come, and errs: some it misses, others never came."""

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, Memory

LOSS = Parameter("loss_db", 0.0, 0.0, 100.0, "dB")
HERALDED = Parameter("herald_efficiency", 1.0, 0.0, 1.0)
FALSE = Parameter("false_herald", 0.0, 0.0, 1.0)


async def store(values: Values, seed: int) -> Outcome:
    """Store photons that arrive; count those that are heralded, and of these those there."""
    memory = Memory(
        herald_efficiency=number(values, HERALDED.name), false_herald=number(values, FALSE.name)
    )
    network = configuration(
        seed,
        [fiber(*TESTED, connectors_db=number(values, LOSS.name))],
        {"alice": Device(), "bob": Device(memory=memory)},
    )
    laboratory = Laboratory(network)
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    sent = heralded = there = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        await alice.create(size, block)
        await alice.send({(block, 1): TESTED[0]})
        sent += size
        if await bob.receive((block, 1), TESTED[1]) is None:
            continue
        heralds = np.frombuffer((await bob.store((block, 1))).arrived, np.uint8) > 0
        found = await bob.measure((block, 1))
        heralded += int(np.count_nonzero(heralds))
        there += int(np.count_nonzero(heralds & (found != NO_CLICK)))
    return {"heralded": proportion(heralded, sent), "there": proportion(there, heralded)}


def _heralded(values: Values) -> tuple[float, float]:
    """Return of which share of the photons a herald tells that came, and of which that did not."""
    passes = theory.transmission(number(values, LOSS.name))
    return passes * number(values, HERALDED.name), (1 - passes) * number(values, FALSE.name)


def right(values: Values) -> float:
    true, false = _heralded(values)
    return true / (true + false)


MEMORY_HERALDS = Experiment(
    "memory-heralds",
    "heralds of a memory that takes in light",
    (LOSS, HERALDED, FALSE, pairs_parameter(1_000_000)),
    (
        Measure("heralded", "photons that are heralded", lambda values: sum(_heralded(values))),
        Measure("there", "heralded photons that are there", right),
    ),
    store,
)
