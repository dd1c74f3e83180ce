"""BB84 behind a fibre by the source that the light is of: pulses seen, errors, and the key.

Detectors, errors and the fibre are those of evidence.curves.decoy_states; detectors may be unlike.
"""

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import theory
from evidence.curves.decoy_states import (
    DARK_COUNT,
    EFFICIENCY,
    ERROR,
    LENGTH,
    LOSS_DB_PER_KM,
    detectors,
    way,
)
from evidence.curves.estimates import Estimate, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration
from evidence.curves.parameters import Parameter, Values
from evidence.curves.prepared_states import exchange
from hosts.middleware.qkd.key_length import asymptotic_fraction
from wire.parameters.physics import Device, PairSource

SOURCES = {  # typed with commas between them; a laser by its mean of photons a pulse
    "single": PairSource(),
    "single-g2-0.02": PairSource(g2=0.02),
    "laser-0.1": PairSource("poisson", 0.1),
    "laser-0.01": PairSource("poisson", 0.01),
    "heralded": PairSource("thermal", 0.02, heralding_efficiency=0.7),
}
SOURCE = Parameter("source", "single", choices=tuple(SOURCES))
MISMATCH = Parameter("efficiency_mismatch", 0.0, 0.0, 1.0)


async def send(values: Values, seed: int) -> Outcome:
    source, mismatch = source_of(values), number(values, MISMATCH.name)
    devices = {"alice": Device(source), "bob": Device(detectors=detectors(mismatch))}
    laboratory = Laboratory(configuration(seed, [way(values)], devices))
    found = await exchange(laboratory, int(values["pairs"]), np.random.default_rng(seed))
    return {
        "gain": found.gain(),
        "qber": found.qber,
        "ones": proportion(found.ones, int(found.seen.sum())),
        "key": key(found.gain(), found.qber, source.multi_photon),
    }


def key(gain: Estimate, qber: Estimate, several: float) -> Estimate:
    """Return the secret bits of a pulse of long keys (GLLP); its error is propagated."""

    def rate(seen: float, wrong: float) -> float:
        return seen / 2 * asymptotic_fraction(wrong, 1 - several / seen) if seen else 0.0

    by_gain = rate(gain.value + gain.error, qber.value) - rate(gain.value, qber.value)
    by_qber = rate(gain.value, qber.value) - rate(gain.value, qber.value + qber.error)
    error = float(np.hypot(by_gain, by_qber))
    return Estimate(rate(gain.value, qber.value), max(error, gain.error / 2))


def source_of(values: Values) -> PairSource:
    return SOURCES[str(values[SOURCE.name])]


def _missed(source: PairSource, arrives: float) -> float:
    """Return how likely no photon of a pulse is among those that arrive so likely, in theory."""
    if source.statistics == "single":
        second = source.multi_photon
        return (1 - arrives) * (1 - second + second * (1 - arrives))
    mean = source.mean_pairs
    if not source.heralding_efficiency:
        return theory.no_click(source.statistics, mean, arrives)
    both = 1 - (1 - source.heralding_efficiency) * (1 - arrives)  # neither half is seen
    missed = theory.no_click(source.statistics, mean, arrives)
    unheralded = theory.no_click(source.statistics, mean, source.heralding_efficiency)
    return unheralded + missed - theory.no_click(source.statistics, mean, both)


def _seen(values: Values) -> tuple[float, float]:
    """Return how likely a pulse is seen, and seen wrongly, in theory; detectors are alike."""
    arrives = EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * number(values, LENGTH.name))
    source, quiet = source_of(values), 1 - DARK_COUNT
    right, wrong = (quiet * _missed(source, arrives * e) for e in (1 - ERROR, ERROR))
    neither = quiet**2 * _missed(source, arrives)
    both = 1 - right - wrong + neither
    return 1 - neither, right - neither + both / 2


def _gain(values: Values) -> float | None:
    return None if values[MISMATCH.name] else _seen(values)[0]


def _qber(values: Values) -> float | None:
    gain, wrong = _seen(values)
    return None if values[MISMATCH.name] else wrong / gain


def _key(values: Values) -> float | None:
    gain, wrong = _seen(values)
    several, qber = source_of(values).multi_photon, wrong / gain
    return None if values[MISMATCH.name] else theory.gllp(gain, qber, 1 - several / gain) / 2


def _ones(values: Values) -> float | None:
    """Return the share of ones of single photons; dark counts are some 1e-5 of what is seen."""
    if source_of(values) != SOURCES["single"] or number(values, LENGTH.name) > 0:
        return None
    less = number(values, MISMATCH.name)
    dark = DARK_COUNT * (1 - EFFICIENCY)
    one, zero = EFFICIENCY * (1 - less) / 2 + dark, EFFICIENCY / 2 + dark
    return one / (one + zero)


LIGHT_SOURCES = Experiment(
    "light-sources",
    "BB84 by the light of different sources",
    (LENGTH, SOURCE, MISMATCH, pairs_parameter(1_000_000)),
    (
        Measure("gain", "pulses seen", _gain),
        Measure("qber", "error rate (QBER)", _qber),
        Measure("ones", "ones among the bits", _ones),
        Measure("key", "secret bits per pulse", _key),
    ),
    send,
)
