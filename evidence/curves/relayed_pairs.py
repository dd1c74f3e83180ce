"""MDI-QKD over distance by down-conversion: halves of pairs are the pulses, heralded or not.

Fibres, errors, detectors and relay are those of evidence.curves.relayed_keys. The key is that of
pulses whose numbers of photons are known, as endlessly many intensities would tell.
"""

from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory
from dispatcher.layer.ownership import BlockName
from evidence.curves import multi_pair, relay_theory
from evidence.curves.decoy_states import LENGTH
from evidence.curves.estimates import Estimate, of_counts, proportion
from evidence.curves.experiment import Experiment, Measure, Outcome, number, pairs_parameter
from evidence.curves.link import configuration
from evidence.curves.parameters import Parameter, Values
from evidence.curves.relayed_keys import (
    CORRECTION,
    DARK_COUNT,
    ERROR,
    PREPARATION_ERROR,
    WAYS,
    X,
    Z,
    arrives,
    fibers,
    relay,
    sifted,
)
from evidence.curves.superdense import blocks
from hosts.middleware.qkd.key_length import binary_entropy
from wire.parameters.physics import Device, PairSource

SESSION = 1
STATISTICS = Parameter("statistics", "thermal", choices=("thermal", "poisson"))
MEAN = Parameter(multi_pair.MEAN.name, 0.2, 0.001, 1.0)
HERALDING = Parameter("heralding_efficiency", 0.0, 0.0, 1.0)
NODES = 10  # of an integral over the mean of thermal light: of 1 and less it is as good as exact

Counts = NDArray[np.int64]  # by basis, right and wrong, and whether both pulses had one photon


async def meet(values: Values, seed: int) -> Outcome:
    """Send pulses from both ends, in states of Z and X; sift announced pulses."""
    source = Device(source_of(values))
    devices = {"alice": source, "bob": source, "charlie": relay()}
    laboratory = Laboratory(configuration(seed, fibers(values), devices))
    hosts = [laboratory.host(name) for name in ("alice", "bob")]
    charlie, random = laboratory.host("charlie"), np.random.default_rng(seed)
    counts, sent = np.zeros((2, 2, 2), np.int64), 0
    for block, size in enumerate(blocks(int(values["pairs"]))):
        states = random.integers(0, 4, (2, size), dtype=np.uint8)
        names, single = [(2 * block, 0), (2 * block + 1, 0)], np.ones(size, bool)
        for host, own, name, way in zip(hosts, states, names, WAYS, strict=True):
            await host.prepare(own, name[0])
            single &= _photons(laboratory, name, size) == 1
            await host.send({name: way[0]})
        bases = states >> 1
        same = bases[0] == bases[1]
        sent += int((same & (bases[0] == Z)).sum())
        kept, wrong = await sifted(charlie, names, states)
        np.add.at(counts, (bases[0][kept], wrong, single[kept].astype(np.uint8)), 1)
    right, wrong = counts.sum(axis=2).T
    return {
        "gain": proportion(int(right[Z] + wrong[Z]), sent),
        "qber": proportion(int(wrong[Z]), int(right[Z] + wrong[Z])),
        "qber_x": proportion(int(wrong[X]), int(right[X] + wrong[X])),
        "key": key(counts, sent),
    }


def source_of(values: Values) -> PairSource:
    """Return the source of either end."""
    return PairSource(
        str(values[STATISTICS.name]),
        number(values, MEAN.name),
        preparation_error=PREPARATION_ERROR,
        heralding_efficiency=number(values, HERALDING.name),
    )


def _photons(laboratory: Laboratory, name: tuple[int, int], size: int) -> NDArray[np.int64]:
    (block,) = laboratory.layer.ownership.parts(BlockName(SESSION, *name))
    own = block.register.present.astype(np.int64)
    return (
        own
        if block.extra_pairs is None
        else own + np.bincount(block.extra_pairs.pulses, minlength=size)
    )


def key(counts: Counts, sent: int) -> Estimate:
    """Return the secret bits of a pair of pulses in Z; its error is propagated."""

    def rate(given: NDArray[Any]) -> float:
        announced, single = given[Z].sum(axis=1), given[:, :, 1]
        if not single[Z].sum() or not single[X].sum():
            return 0.0
        secret = single[Z].sum() * (1 - binary_entropy(single[X, 1] / single[X].sum()))
        leak = CORRECTION * announced.sum() * binary_entropy(announced[1] / announced.sum())
        return float(secret - leak) / sent

    found = of_counts(rate, counts)
    return replace(found, value=max(0.0, found.value))


def _mixture(values: Values) -> list[tuple[float, float]]:
    """Return a source's pulses as laser pulses without a phase: weights, and means before loss.

    Thermal light is a laser whose mean is drawn from an exponential distribution. Of the pulses
    with n photons a herald misses (1 - h)^n: what is let out is all light but that, which is light
    of the same kind with a smaller mean, and nothing in its stead.
    """
    mean, kind = number(values, MEAN.name), str(values[STATISTICS.name])
    missed = 1 - number(values, HERALDING.name)
    parts = [(1.0, mean)]
    if missed < 1:
        if kind == "thermal":
            share = 1 / (1 + mean * (1 - missed))
            less = mean * missed * share
        else:
            share, less = float(np.exp(-mean * (1 - missed))), mean * missed
        parts += [(-share, less), (share, 0.0)]
    if kind == "poisson":
        return parts
    means, weights = np.polynomial.laguerre.laggauss(NODES)
    return [
        (part * float(weight), mean * float(each))
        for part, mean in parts
        for each, weight in zip(means, weights, strict=True)
    ]


def _announced(values: Values, basis: int) -> tuple[float, float]:
    return _of_mixture(tuple(_mixture(values)), _arrives(values), basis)


@lru_cache(maxsize=16)  # several measures of a point ask for it
def _of_mixture(
    mixture: tuple[tuple[float, float], ...], seen: float, basis: int
) -> tuple[float, float]:
    formula, announced, wrong = (relay_theory.rectilinear, relay_theory.diagonal)[basis], 0.0, 0.0
    for (one, a), (other, b) in product(mixture, repeat=2):
        gain, errs = formula(a * seen, b * seen, DARK_COUNT, ERROR)
        announced, wrong = announced + one * other * gain, wrong + one * other * errs
    return announced, wrong


def _arrives(values: Values) -> float:
    return arrives(number(values, LENGTH.name))


def _qber(values: Values, basis: int) -> float:
    announced, wrong = _announced(values, basis)
    return wrong / announced


def _single(values: Values) -> float:
    mean, seen = number(values, MEAN.name), number(values, HERALDING.name) or 1.0
    one = mean / (1 + mean) ** 2 if values[STATISTICS.name] == "thermal" else mean * np.exp(-mean)
    return float(one * seen)


def _key(values: Values) -> float:
    """Return the key of single photons in both arms (Lo, Curty, Qi)."""
    seen = _arrives(values)
    announced, wrong = relay_theory.single_photons(seen, seen, DARK_COUNT, ERROR)
    gain, differ = _announced(values, Z)
    secret = _single(values) ** 2 * announced * (1 - binary_entropy(wrong / announced))
    return max(0.0, secret - CORRECTION * gain * binary_entropy(differ / gain))


RELAYED_PAIRS = Experiment(
    "mdi-pairs",
    "MDI-QKD over distance, by down-conversion",
    (LENGTH, STATISTICS, MEAN, HERALDING, pairs_parameter(2_000_000)),
    (
        Measure("gain", "pulses announced, in Z", lambda values: _announced(values, Z)[0]),
        Measure("qber", "errors in Z", lambda values: _qber(values, Z)),
        Measure("qber_x", "errors in X", lambda values: _qber(values, X)),
        Measure("key", "secret bits per pair of pulses", _key),
    ),
    meet,
)
