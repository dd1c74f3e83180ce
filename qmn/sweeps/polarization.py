"""Polarisation behind a fibre that turns it about any axis: how often a basis is told wrongly."""

import math
from typing import Any

import numpy as np

from dispatcher.laboratory import Laboratory
from qmn.sweeps import theory
from qmn.sweeps.estimates import proportion
from qmn.sweeps.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from qmn.sweeps.link import TESTED, configuration, fiber
from qmn.sweeps.parameters import Parameter, Values
from qmn.sweeps.superdense import blocks

LENGTH = Parameter("length_km", 1.0, 0.0, 20_000.0, "km")
DRIFT = Parameter("polarization_drift_rad_per_sqrt_km", 0.3, 0.0, 100.0, "rad/sqrt km")
BASES = ("z", "x", "y")
FAST_S = 1e-9  # each photon meets a turn of its own: the mean over all turns


async def turn(values: Values, seed: int) -> Outcome:
    """Send states of all three bases, and measure each in its own."""
    given: dict[str, Any] = {each.name: number(values, each.name) for each in (LENGTH, DRIFT)}
    way = fiber(*TESTED, **given, polarization_drift_time_s=FAST_S)
    laboratory = Laboratory(configuration(seed, [way]))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    wrong, all_of = np.zeros(len(BASES), np.int64), np.zeros(len(BASES), np.int64)
    for block, size in enumerate(blocks(int(values["pairs"]))):
        states = (np.arange(size) % (2 * len(BASES))).astype(np.uint8)
        await alice.prepare(states, block)
        await alice.send({(block, 0): TESTED[0]})
        await bob.receive((block, 0), TESTED[1])
        bits = await bob.measure((block, 0), bases=states >> np.uint8(1))
        errors = (bits ^ states) & np.uint8(1)
        wrong += np.bincount(states >> 1, errors, len(BASES)).astype(np.int64)
        all_of += np.bincount(states >> 1, minlength=len(BASES))
    return {basis: proportion(int(wrong[i]), int(all_of[i])) for i, basis in enumerate(BASES)}


def expected(values: Values) -> float:
    """Return what theory says of each basis."""
    rms_rad = number(values, DRIFT.name) * math.sqrt(number(values, LENGTH.name))
    return theory.birefringence_error(rms_rad)


POLARIZATION = Experiment(
    "polarization",
    "polarisation that a fibre turns about any axis",
    (LENGTH, DRIFT, pairs_parameter()),
    tuple(Measure(basis, f"error in {basis.upper()}", expected) for basis in BASES),
    turn,
)
