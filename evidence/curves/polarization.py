"""Polarisation behind a fibre: how often a basis is seen wrongly.

The fibre turns it about any axis, or lets two polarisations fare differently.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Device, PairSource

LENGTH = Parameter("length_km", 1.0, 0.0, 20_000.0, "km")
DRIFT = Parameter("polarization_drift_rad_per_sqrt_km", 0.3, 0.0, 100.0, "rad/sqrt km")
BASES = ("z", "x", "y")
FAST_S = 1e-9  # each photon meets a turn of its own: the mean over all turns


LOSS = Parameter("pdl_db", 0.0, 0.0, 100.0, "dB")
DISPERSION = Parameter("pmd_ps_per_sqrt_km", 0.0, 0.0, 1_000.0, "ps/sqrt km")
BANDWIDTH = Parameter("bandwidth_nm", 0.0, 0.0, 100.0, "nm")


async def turn(values: Values, seed: int) -> Outcome:
    wrong, came, _sent = await behind(values, (LENGTH, DRIFT), seed)
    return {basis: proportion(int(wrong[i]), int(came[i])) for i, basis in enumerate(BASES)}


async def separate(values: Values, seed: int) -> Outcome:
    wrong, came, sent = await behind(values, (LENGTH, LOSS, DISPERSION), seed)
    errors = proportion(int(wrong.sum()), int(came.sum()))
    return {"error": errors, "arrived": proportion(int(came.sum()), sent)}


async def behind(
    values: Values, parameters: tuple[Parameter, ...], seed: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return how many were wrong, and how many came, of each basis, and how many were sent."""
    given: dict[str, Any] = {each.name: number(values, each.name) for each in parameters}
    way = fiber(*TESTED, **given, polarization_drift_time_s=FAST_S)
    source = PairSource(bandwidth_nm=float(values.get(BANDWIDTH.name, 0.0)))
    laboratory = Laboratory(configuration(seed, [way], {"alice": Device(source)}))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    wrong, came = np.zeros(len(BASES), np.int64), np.zeros(len(BASES), np.int64)
    sent = 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        states = (np.arange(size) % (2 * len(BASES))).astype(np.uint8)
        await alice.prepare(states, block)
        await alice.send({(block, 0): TESTED[0]})
        await bob.receive((block, 0), TESTED[1])
        bits = await bob.measure((block, 0), bases=states >> np.uint8(1))
        sent, there = sent + size, bits != NO_CLICK
        bases, errors = states[there] >> 1, (bits ^ states)[there] & np.uint8(1)
        wrong += np.bincount(bases, errors, len(BASES)).astype(np.int64)
        came += np.bincount(bases, minlength=len(BASES))
    return wrong, came, sent


def expected(values: Values) -> float:
    rms_rad = number(values, DRIFT.name) * math.sqrt(number(values, LENGTH.name))
    return theory.birefringence_error(rms_rad)


POLARIZATION = Experiment(
    "polarization",
    "polarisation that a fibre turns about any axis",
    (LENGTH, DRIFT, pairs_parameter()),
    tuple(Measure(basis, f"error in {basis.upper()}", expected) for basis in BASES),
    turn,
)


def wrong_behind(values: Values) -> float:
    """Return what theory says of errors in any basis behind loss and delay; they compose."""
    mean_s = number(values, DISPERSION.name) * math.sqrt(number(values, LENGTH.name)) * 1e-12
    width = theory.rad_per_s(number(values, BANDWIDTH.name))
    kept = (1 - 2 * theory.dependent_loss_error(number(values, LOSS.name))) * (
        1 - 2 * theory.mode_dispersion_error(mean_s, width)
    )
    return (1 - kept) / 2


MODES = Experiment(
    "polarization-modes",
    "polarisations that a fibre loses or delays differently",
    (LENGTH, LOSS, DISPERSION, BANDWIDTH, pairs_parameter()),
    (
        Measure("error", "error in any basis", wrong_behind),
        Measure(
            "arrived",
            "light that comes through",
            lambda values: (1 + theory.transmission(number(values, LOSS.name))) / 2,
        ),
    ),
    separate,
)
