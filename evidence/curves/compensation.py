"""Polarisation that drifts, and that a compensator undoes now and then."""

import math
from functools import cache

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from numpy.polynomial.laguerre import laggauss
from numpy.polynomial.legendre import leggauss

from evidence.curves.estimates import ratio
from evidence.curves.experiment import Outcome
from evidence.curves.link import TESTED, blocks, fiber, network
from evidence.curves.parameters import Point
from wire.outcomes import NO_CLICK
from wire.parameters.physics import INTERRUPTING, Compensator, Device

RATE_HZ = 10_000
NODES = 24  # of each quadrature

Theory = dict[str, float]


async def run(v: Point, seed: int) -> Outcome:
    """Count errors of photons in Z, X and Y, and those that an interrupting reference leaves."""
    part = Compensator(
        retarders=4, every_s=v.every_s, reference=INTERRUPTING, measuring_s=v.measuring_s
    )
    way = fiber(
        *TESTED,
        length_km=v.length_km,
        polarization_drift_rad_per_sqrt_km=v.polarization_drift_rad_per_sqrt_km,
        polarization_drift_time_s=v.polarization_drift_time_s,
    )
    laboratory = network(seed, [way], bob=Device(compensator=part))
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    wrong, came, sent = [], [], []
    for block, size in blocks(v.pairs):
        states = (np.arange(size) % 6).astype(np.uint8)
        await alice.prepare(states, block)
        await alice.send({(block, 0): TESTED[0]}, RATE_HZ)
        await bob.receive((block, 0), TESTED[1])
        bits = await bob.measure((block, 0), bases=states >> np.uint8(1))
        there = bits != NO_CLICK
        wrong.append(int(np.count_nonzero((bits ^ states)[there] & 1)))
        came.append(int(np.count_nonzero(there)))
        sent.append(size)
        await laboratory.wait(v.gap_s)
    return {"error": ratio(wrong, came), "arrived": ratio(came, sent)}


def expected(v: Point) -> Theory:
    """Average errors over the time since the look, which is even from measuring_s to every_s."""
    rms_rad = v.polarization_drift_rad_per_sqrt_km * math.sqrt(v.length_km)
    places, weights = leggauss(NODES)
    ages_s = v.measuring_s + (v.every_s - v.measuring_s) * (places + 1) / 2
    errors = [error(rms_rad, math.exp(-age_s / v.polarization_drift_time_s)) for age_s in ages_s]
    return {
        "error": float(np.dot(errors, weights) / 2),
        "arrived": 1 - v.measuring_s / v.every_s,
    }


@cache
def error(rms_rad: float, correlation: float) -> float:
    """Return how often a basis is seen wrongly behind turns that were undone as they were before.

    Each of n turns is by a normal vector, whose components have the variance v = rms^2 / 3n and
    this correlation with the earlier one. Of a direction the turn and the inverse of the earlier
    one leave k = E[4 (q q')^2 - 1] / 3 on average, q and q' being their quaternions, and all n k^n:
    the innermost two are a multiple of the identity on average, and so the next ones meet.
    """
    turns = max(math.ceil(rms_rad**2), 1)
    sigma = rms_rad / math.sqrt(3 * turns)
    x, of_x = hermegauss(NODES)
    u, of_u = laggauss(NODES)
    # The earlier vector has the length |x| sigma, weighed by x^2; the later one has z along it.
    length = (x * sigma)[:, None, None]
    spread = sigma * math.sqrt(1 - correlation**2)
    z = correlation * length + spread * x[None, :, None]
    later = np.sqrt(z**2 + 2 * u[None, None, :] * spread**2)
    dot = np.cos(length / 2) * np.cos(later / 2)
    dot = dot + np.sin(length / 2) * z * np.sinc(later / 2 / np.pi) / 2
    weights = (of_x * x**2)[:, None, None] * of_x[None, :, None] * of_u / (2 * np.pi)
    left = float((weights * (4 * dot**2 - 1)).sum()) / 3
    return (1 - left**turns) / 2
