"""A Bell measurement of Phi+ by gates with depolarising noise: a CX, an H, two readings."""

from functools import partial

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.parameters.physics import BellAnalyser, Device, Gates

ONE, TWO = (Parameter(f"{gate}_qubit_depolarizing", 0.0) for gate in ("one", "two"))
STATES = {"psi_plus": 1, "phi_minus": 2, "psi_minus": 3}  # wrong outcomes


async def tell(values: Values, seed: int) -> Outcome:
    """Measure perfect pairs; count the Bell states found."""
    gates = Gates("any", number(values, ONE.name), number(values, TWO.name))
    device = Device(gates=gates, analyser=BellAnalyser("gates"))
    alice = Laboratory(configuration(seed, [], {"alice": device})).host("alice")
    counts = np.zeros(4, np.int64)
    for block, size in enumerate(blocks(int(values["pairs"]))):
        await alice.create(size, block)
        counts += np.bincount(await alice.bell_measure((block, 0), (block, 1)), minlength=4)
    pairs = int(counts.sum())
    return {name: proportion(int(counts[state]), pairs) for name, state in STATES.items()}


def expected(state: int, values: Values) -> float:
    return theory.gated_bell_outcomes(number(values, ONE.name), number(values, TWO.name))[state]


GATED_BELL = Experiment(
    "gated-bell",
    "a Bell measurement of Phi+ by gates with noise",
    (ONE, TWO, pairs_parameter()),
    tuple(
        Measure(name, f"how often {name.replace('_', ' ')} is reported", partial(expected, state))
        for name, state in STATES.items()
    ),
    tell,
)
