"""MDI-QKD over distance: two lasers with decoy states, and a relay in the middle.

Fibres of .2 dB/km, an error of 1.5 % of both preparations together, detectors as superconducting
nanowires (90 %, 1e-6 dark counts in a gate), corrections at 1.16 times the limit.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory, LaboratoryHost
from evidence.curves import relay_theory, theory
from evidence.curves.decoy_states import GATE_S, LENGTH, LOSS_DB_PER_KM
from evidence.curves.estimates import Estimate, of_counts, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.superdense import blocks
from hosts.middleware.qkd.decoy import SHARES, Decoys
from hosts.middleware.qkd.key_length import binary_entropy
from hosts.middleware.qkd.relayed_decoys import PairSifted, bounds
from hosts.middleware.services.key_distribution.relayed import fitting
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.physics import BEAM_SPLITTER, BellAnalyser, Detectors, Device, PairSource

SIGNAL, WEAK = 0.4, 0.1
MEAN = Parameter("mean_photons", SIGNAL, 0.2, 1.0)
EFFICIENCY, DARK_COUNT, ERROR, CORRECTION = 0.9, 1e-6, 0.015, 1.16
DETECTORS = Detectors(EFFICIENCY, -math.log1p(-DARK_COUNT) / GATE_S, GATE_S)
PREPARATION_ERROR = (1 - math.sqrt(1 - 2 * ERROR)) / 2  # of either end: one of both, and not both
WAYS = ("alice-q0", "charlie-q0"), ("bob-q0", "charlie-q1")
Z, X = 0, 1

Counts = NDArray[np.int64]  # by basis, right and wrong, alice's level, and bob's


async def meet(values: Values, seed: int) -> Outcome:
    """Send pulses of three intensities from both ends, in Z and X; sift what charlie announces."""
    decoys = decoys_of(values)
    laboratory = Laboratory(configuration(seed, fibers(values), devices(decoys)))
    hosts = [laboratory.host(name) for name in ("alice", "bob")]
    charlie, random = laboratory.host("charlie"), np.random.default_rng(seed)
    counts, sent = np.zeros((2, 2, 3, 3), np.int64), np.zeros((2, 3, 3), np.int64)
    for block, size in enumerate(blocks(int(values["pairs"]))):
        states = random.integers(0, 4, (2, size), dtype=np.uint8)
        levels = random.choice(3, (2, size), p=SHARES).astype(np.uint8)
        names = [(2 * block, 0), (2 * block + 1, 0)]
        for host, own, level, name, way in zip(hosts, states, levels, names, WAYS, strict=True):
            await host.prepare(own, name[0], level)
            await host.send({name: way[0]})
        bases = states >> 1
        same = bases[0] == bases[1]
        np.add.at(sent, (bases[0][same], *levels[:, same]), 1)
        kept, wrong = await sifted(charlie, names, states)
        np.add.at(counts, (bases[0][kept], wrong, *levels[:, kept]), 1)
    signal = counts[:, :, 0, 0]
    return {
        "gain": proportion(int(signal[Z].sum()), int(sent[Z, 0, 0])),
        "qber": proportion(int(signal[Z, 1]), int(signal[Z].sum())),
        "qber_x": proportion(int(signal[X, 1]), int(signal[X].sum())),
        "key": key(decoys, counts, int(sent[Z, 0, 0])),
    }


async def sifted(
    charlie: LaboratoryHost, names: Sequence[tuple[int, int]], states: NDArray[np.uint8]
) -> tuple[NDArray[np.bool_], NDArray[np.uint8]]:
    """Have the relay measure what both ends have sent; return which pulses they keep, shape (n,).

    And of each that is kept, shape (kept,), whether their bits differ. `states`, shape (2, n), are
    theirs.
    """
    bases = states >> 1
    came = [await charlie.receive(name, way[1]) for name, way in zip(names, WAYS, strict=True)]
    if None in came:
        return np.zeros(states.shape[1], bool), np.zeros(0, np.uint8)
    outcomes = await charlie.bell_measure(names[0], names[1])
    kept = (bases[0] == bases[1]) & (outcomes != NO_COINCIDENCE)
    bits = states[:, kept] & np.uint8(1)
    return kept, bits[0] ^ fitting(bits[1], bases[1][kept], outcomes[kept])


def decoys_of(values: Values) -> Decoys:
    return Decoys((number(values, MEAN.name), WEAK, 0.0))


def fibers(values: Values) -> list[Any]:
    length_km = number(values, LENGTH.name) / 2
    return [fiber(*way, length_km=length_km, loss_db_per_km=LOSS_DB_PER_KM) for way in WAYS]


def devices(decoys: Decoys) -> dict[str, Device]:
    laser = PairSource(
        "poisson", decoys.means[0], decoys=decoys.means[1:], preparation_error=PREPARATION_ERROR
    )
    return {"alice": Device(laser), "bob": Device(laser), "charlie": relay()}


def relay() -> Device:
    return Device(detectors=DETECTORS, analyser=BellAnalyser(BEAM_SPLITTER))


def key(decoys: Decoys, counts: Counts, pulses: int) -> Estimate:
    """Return the secret bits of a pair of signals in Z, of endless keys; its error is propagated.

    Of the single photons, signals are as many as follows from the intensities.
    """
    share = decoys.shares[0] * decoys.means[0] * math.exp(-decoys.means[0]) / decoys.photons(1)

    def rate(given: NDArray[Any]) -> float:
        sifted = PairSifted(given[Z].sum(axis=0), given[X].sum(axis=0), given[X, 1])
        signal = given[Z, :, 0, 0]
        leak = CORRECTION * signal.sum() * binary_entropy(signal[1] / signal.sum())
        secret = bounds((decoys, decoys), sifted, None).secret * share**2
        return float(secret - leak) / pulses

    found = of_counts(rate, counts)
    return replace(found, value=max(0.0, found.value))


def arrives(length_km: float) -> float:
    return EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * length_km / 2)


def _signal(values: Values, basis: int) -> tuple[float, float]:
    formula = (relay_theory.rectilinear, relay_theory.diagonal)[basis]
    seen = number(values, MEAN.name) * arrives(number(values, LENGTH.name))
    return formula(seen, seen, DARK_COUNT, ERROR)


def _qber(values: Values, basis: int) -> float:
    gain, wrong = _signal(values, basis)
    return wrong / gain


def _key(values: Values) -> float:
    """Return the key of two decoys, by the formulas of Xu, Curty, Qi and Lo."""
    means, seen = decoys_of(values).means, arrives(number(values, LENGTH.name))
    tables = [
        {
            (i, j): formula(means[i] * seen, means[j] * seen, DARK_COUNT, ERROR)
            for i, j in product(range(3), repeat=2)
        }
        for formula in (relay_theory.rectilinear, relay_theory.diagonal)
    ]
    return relay_theory.decoy_key(means, tables[Z], tables[X], CORRECTION)


RELAYED_KEYS = Experiment(
    "mdi",
    "MDI-QKD over distance, with decoy states",
    (LENGTH, MEAN, pairs_parameter(4_000_000)),
    (
        Measure("gain", "signals announced, in Z", lambda values: _signal(values, Z)[0]),
        Measure("qber", "errors of signals in Z", lambda values: _qber(values, Z)),
        Measure("qber_x", "errors of signals in X", lambda values: _qber(values, X)),
        Measure("key", "secret bits per pair of signals", _key),
    ),
    meet,
)
