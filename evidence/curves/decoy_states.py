"""Decoy-state BB84 behind a fibre: pulses seen, errors, and the key (arXiv:1311.7129).

Detectors and errors are those of the paper's section IV, but for afterpulses: efficiency 10 %,
6e-7 dark counts in a gate, errors of .5 %, .2 dB/km, error correction at 1.16 times the limit.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.estimates import Estimate, of_counts
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import TESTED, configuration, fiber
from evidence.curves.parameters import Parameter, Values
from evidence.curves.prepared_states import Counts, exchange
from hosts.middleware.qkd.decoy import SHARES, Decoys, Sifted, bounds
from hosts.middleware.qkd.key_length import binary_entropy
from wire.parameters.fiber import Fiber
from wire.parameters.physics import Detectors, Device, PairSource

LENGTH = Parameter("length_km", 0.0, 0.0, 200.0, "km")
MEAN = Parameter("mean_photons", 0.5, 0.2, 1.0)
WEAK = 0.1
LOSS_DB_PER_KM, EFFICIENCY, DARK_COUNT, ERROR, CORRECTION = 0.2, 0.1, 6e-7, 5e-3, 1.16
GATE_S = 1e-9
X = 1


async def send(values: Values, seed: int) -> Outcome:
    decoys = decoys_of(values)
    laboratory = Laboratory(configuration(seed, [way(values)], devices(decoys)))
    random = np.random.default_rng(seed)
    found = await exchange(laboratory, int(values["pairs"]), random, SHARES)
    return {
        "gain": found.gain(),
        "weak": found.gain(1),
        "qber": found.qber,
        "key": key(decoys, found.counts, int(found.sent.sum())),
    }


def decoys_of(values: Values) -> Decoys:
    return Decoys((number(values, MEAN.name), WEAK, 0.0))


def way(values: Values) -> Fiber:
    """Return the fibre: depolarising by p is an error of p/2 in either basis."""
    length_km = number(values, LENGTH.name)
    losses = {"length_km": length_km, "loss_db_per_km": LOSS_DB_PER_KM}
    optics: dict[str, Any] = {**losses, "depolarizing": 2 * ERROR}
    return fiber(*TESTED, **optics)


def devices(decoys: Decoys) -> dict[str, Device]:
    laser = PairSource("poisson", decoys.means[0], decoys=decoys.means[1:])
    return {"alice": Device(laser), "bob": Device(detectors=detectors())}


def detectors(mismatch: float = 0.0) -> Detectors:
    """Return the detectors, of which that of 1 sees so much less."""
    dark_count_hz = -math.log1p(-DARK_COUNT) / GATE_S
    return Detectors(EFFICIENCY, dark_count_hz, GATE_S, efficiency_mismatch=mismatch)


def key(decoys: Decoys, counts: Counts, pulses: int) -> Estimate:
    """Return the secret bits of a pulse of endless keys; its error is propagated count by count."""

    def rate(given: NDArray[Any]) -> float:
        sifted = Sifted(given[X].sum(axis=0), given[1 - X].sum(axis=0), given[1 - X][1])
        leak = CORRECTION * sifted.key.sum() * binary_entropy(given[X][1].sum() / sifted.key.sum())
        return max(0.0, float(bounds(decoys, sifted, None).secret - leak)) / pulses

    return of_counts(rate, counts)


def _seen(values: Values, level: int) -> tuple[float, float]:
    arrives = EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * number(values, LENGTH.name))
    mean = decoys_of(values).means[level] * arrives
    return theory.weak_pulse(mean, DARK_COUNT, ERROR)


def _qber(values: Values) -> float:
    gain, wrong = _seen(values, 0)
    return wrong / gain


def _key(values: Values) -> float:
    means = decoys_of(values).means
    return theory.decoy_key(means, SHARES, [_seen(values, i) for i in range(3)], CORRECTION)


DECOY_STATES = Experiment(
    "decoy-states",
    "BB84 with decoy states",
    (LENGTH, MEAN, pairs_parameter(4_000_000)),
    (
        Measure("gain", "signal pulses seen", lambda values: _seen(values, 0)[0]),
        Measure("weak", "weak pulses seen", lambda values: _seen(values, 1)[0]),
        Measure("qber", "errors of the signal", _qber),
        Measure("key", "secret bits per pulse", _key),
    ),
    send,
)
