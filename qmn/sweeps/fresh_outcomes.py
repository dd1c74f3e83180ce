"""Blocks of one name, one after the other: the outcomes of each are its own."""

from itertools import pairwise

import numpy as np

from dispatcher.laboratory import Laboratory
from qmn.sweeps.estimates import proportion
from qmn.sweeps.experiment import Experiment, Measure, Outcome, pairs_parameter
from qmn.sweeps.link import configuration
from qmn.sweeps.parameters import Parameter, Values
from wire.dispatcher_pb2 import MeasureRequest

USES = Parameter("uses", 2, 2, 1_000)
FAIR = 0.5


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
