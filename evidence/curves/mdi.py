"""MDI-QKD over distance: two ends and a relay in the middle, by lasers or by down-conversion.

Fibres of .2 dB/km, an error of 1.5 % of both preparations together, detectors as superconducting
nanowires (90 %, 1e-6 dark counts in a gate), corrections at 1.16 times the limit. Lasers have two
decoys. Halves of pairs are pulses, heralded or not: their key is that of pulses whose numbers of
photons are known, as endlessly many intensities would tell.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from applications.key_distribution.relayed import fitting
from applications.qkd.decoy import SHARES, Decoys
from applications.qkd.key_length import binary_entropy
from applications.qkd.relayed_decoys import PairSifted, bounds
from dispatcher.layer.ownership import BlockName
from evidence.curves import relay_theory, theory
from evidence.curves.bb84 import GATE_S, LOSS_DB_PER_KM, decoys_of
from evidence.curves.estimates import Estimate, of_counts, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import blocks, fiber, network
from evidence.curves.parameters import Point
from evidence.laboratory import SESSION, BlockKey, Laboratory, LaboratoryHost
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.physics import BEAM_SPLITTER, BellAnalyser, Detectors, Device, PairSource

SIGNAL = 0.4  # photons a pulse
EFFICIENCY, DARK_COUNT, ERROR, CORRECTION = 0.9, 1e-6, 0.015, 1.16
DETECTORS = Detectors(EFFICIENCY, -math.log1p(-DARK_COUNT) / GATE_S, GATE_S)
PREPARATION_ERROR = (1 - math.sqrt(1 - 2 * ERROR)) / 2  # of either end: one of both, and not both
WAYS = ("alice-q0", "charlie-q0"), ("bob-q0", "charlie-q1")
Z, X = 0, 1
NODES = 10  # of an integral over the mean of thermal light: of 1 and less it is as good as exact

Counts = NDArray[np.int64]  # by basis, right and wrong, and levels, or whether both are one photon


async def lasers(v: Point, seed: int) -> Outcome:
    """Send pulses of three intensities from both ends, in Z and X; sift what charlie announces."""
    decoys = decoys_of(v)
    mean, *others = decoys.means
    laser = PairSource("poisson", mean, decoys=tuple(others), preparation_error=PREPARATION_ERROR)
    laboratory = relayed(v, seed, laser)
    hosts, charlie, random = *_hosts(laboratory), np.random.default_rng(seed)
    counts, sent = np.zeros((2, 2, 3, 3), np.int64), np.zeros((2, 3, 3), np.int64)
    for block, size in blocks(v.pairs):
        states = random.integers(0, 4, (2, size), dtype=np.uint8)
        levels = random.choice(3, (2, size), p=SHARES).astype(np.uint8)
        names = [(2 * block, 0), (2 * block + 1, 0)]
        for host, prepared, level, name, way in zip(
            hosts, states, levels, names, WAYS, strict=True
        ):
            await host.prepare(prepared, name[0], level)
            await host.send({name: way[0]})
        bases = states >> 1
        same = bases[0] == bases[1]
        np.add.at(sent, (bases[0][same], *levels[:, same]), 1)
        same_basis, wrong = await sifted(charlie, names, states)
        np.add.at(counts, (bases[0][same_basis], wrong, *levels[:, same_basis]), 1)
    signals = int(sent[Z, 0, 0])
    return rates(counts[:, :, 0, 0], signals) | {"key": decoy_key(decoys, counts, signals)}


async def pairs(v: Point, seed: int) -> Outcome:
    """Send pulses from both ends, in states of Z and X; sift announced pulses."""
    laboratory = relayed(
        v,
        seed,
        PairSource(
            str(v["statistics"]),
            v.mean_pairs,
            preparation_error=PREPARATION_ERROR,
            heralding_efficiency=v.heralding_efficiency,
        ),
    )
    hosts, charlie, random = *_hosts(laboratory), np.random.default_rng(seed)
    counts, sent = np.zeros((2, 2, 2), np.int64), 0
    for block, size in blocks(v.pairs):
        states = random.integers(0, 4, (2, size), dtype=np.uint8)
        names, single = [(2 * block, 0), (2 * block + 1, 0)], np.ones(size, bool)
        for host, prepared, name, way in zip(hosts, states, names, WAYS, strict=True):
            await host.prepare(prepared, name[0])
            single &= _photons(laboratory, name, size) == 1
            await host.send({name: way[0]})
        bases = states >> 1
        sent += int(((bases[0] == Z) & (bases[1] == Z)).sum())
        same_basis, wrong = await sifted(charlie, names, states)
        np.add.at(counts, (bases[0][same_basis], wrong, single[same_basis].astype(np.uint8)), 1)
    return rates(counts.sum(axis=2), sent) | {"key": single_key(counts, sent)}


def relayed(v: Point, seed: int, source: PairSource) -> Laboratory:
    optics: dict[str, Any] = {"length_km": v.length_km / 2, "loss_db_per_km": LOSS_DB_PER_KM}
    end, relay = Device(source), Device(detectors=DETECTORS, analyser=BellAnalyser(BEAM_SPLITTER))
    return network(seed, [fiber(*way, **optics) for way in WAYS], alice=end, bob=end, charlie=relay)


def _hosts(laboratory: Laboratory) -> tuple[list[LaboratoryHost], LaboratoryHost]:
    return [laboratory.host(name) for name in ("alice", "bob")], laboratory.host("charlie")


async def sifted(
    charlie: LaboratoryHost, names: Sequence[BlockKey], states: NDArray[np.uint8]
) -> tuple[NDArray[np.bool_], NDArray[np.uint8]]:
    """Let the relay measure what both ends have sent; return which pulses they keep, shape (n,).

    And of each that is kept, shape (kept,), whether their bits differ. `states`, shape (2, n), are
    theirs.
    """
    bases = states >> 1
    came = [await charlie.receive(name, way[1]) for name, way in zip(names, WAYS, strict=True)]
    if None in came:
        return np.zeros(states.shape[1], bool), np.zeros(0, np.uint8)
    outcomes = await charlie.bell_measure(names[0], names[1])
    mask = (bases[0] == bases[1]) & (outcomes != NO_COINCIDENCE)
    bits = states[:, mask] & np.uint8(1)
    return mask, bits[0] ^ fitting(bits[1], bases[1][mask], outcomes[mask])


def _photons(laboratory: Laboratory, name: BlockKey, size: int) -> NDArray[np.int64]:
    (block,) = laboratory.layer.ownership.parts(BlockName(SESSION, *name))
    counts = block.register.present.astype(np.int64)
    if block.extra_pairs is None:
        return counts
    return counts + np.bincount(block.extra_pairs.pulses, minlength=size)


def rates(counts: NDArray[np.int64], sent: int) -> Outcome:
    """Return gain and errors of counts by basis, and right or wrong; `sent` are those in Z."""
    (right_z, wrong_z), (right_x, wrong_x) = counts.tolist()
    return {
        "gain": proportion(right_z + wrong_z, sent),
        "qber": proportion(wrong_z, right_z + wrong_z),
        "qber_x": proportion(wrong_x, right_x + wrong_x),
    }


def decoy_key(decoys: Decoys, counts: Counts, pulses: int) -> Estimate:
    """Return the secret bits of a pair of signals in Z, of endless keys; its error is propagated.

    Of the single photons, signals are as many as follows from the intensities.
    """
    share = decoys.shares[0] * decoys.means[0] * math.exp(-decoys.means[0]) / decoys.photons(1)

    def rate(array: NDArray[Any]) -> float:
        tested = PairSifted(array[Z].sum(axis=0), array[X].sum(axis=0), array[X, 1])
        secret = bounds((decoys, decoys), tested, None).secret * share**2
        return float(secret - leaked(array[Z, :, 0, 0])) / pulses

    figures = of_counts(rate, counts)
    return replace(figures, value=max(0.0, figures.value))


def single_key(counts: Counts, sent: int) -> Estimate:
    """Return the secret bits of a pair of pulses in Z; its error is propagated."""

    def rate(array: NDArray[Any]) -> float:
        single = array[:, :, 1]
        if not single[Z].sum() or not single[X].sum():
            return 0.0
        secret = single[Z].sum() * (1 - binary_entropy(single[X, 1] / single[X].sum()))
        return float(secret - leaked(array[Z].sum(axis=1))) / sent

    figures = of_counts(rate, counts)
    return replace(figures, value=max(0.0, figures.value))


def leaked(announced: NDArray[Any]) -> Any:
    """Return the bits disclosed to correct errors, of right and wrong ones."""
    return CORRECTION * announced.sum() * binary_entropy(announced[1] / announced.sum())


def arrives(length_km: float) -> float:
    return EFFICIENCY * theory.transmission(LOSS_DB_PER_KM * length_km / 2)


def of_lasers(v: Point) -> dict[str, float]:
    """Return also the key of two decoys, by the formulas of Xu, Curty, Qi and Lo."""
    means, seen = decoys_of(v).means, arrives(v.length_km)
    in_z, in_x = (
        {
            (i, j): formula(means[i] * seen, means[j] * seen, DARK_COUNT, ERROR)
            for i, j in product(range(3), repeat=2)
        }
        for formula in (relay_theory.rectilinear, relay_theory.diagonal)
    )
    key = relay_theory.decoy_key(means, in_z, in_x, CORRECTION)
    return announced(in_z[0, 0], in_x[0, 0]) | {"key": key}


def announced(in_z: tuple[float, float], in_x: tuple[float, float]) -> dict[str, float]:
    return {"gain": in_z[0], "qber": in_z[1] / in_z[0], "qber_x": in_x[1] / in_x[0]}


def of_pairs(v: Point) -> dict[str, float]:
    """Return also the key of single photons in both arms (Lo, Curty, Qi)."""
    seen, mixture = arrives(v.length_km), tuple(_mixture(v))
    in_z, in_x = (_of_mixture(mixture, seen, basis) for basis in (Z, X))
    single, wrong = relay_theory.single_photons(seen, seen, DARK_COUNT, ERROR)
    secret = _single(v) ** 2 * single * (1 - binary_entropy(wrong / single))
    leak = CORRECTION * in_z[0] * binary_entropy(in_z[1] / in_z[0])
    return announced(in_z, in_x) | {"key": max(0.0, secret - leak)}


def _mixture(v: Point) -> list[tuple[float, float]]:
    """Return a source's pulses as laser pulses without a phase: weights, and means before loss.

    Thermal light is a laser whose mean is drawn from an exponential distribution. Of the pulses
    with n photons a herald misses (1 - h)^n: what is let out is all light but that, which is light
    of the same kind with a smaller mean, and nothing in its stead.
    """
    mean, is_thermal = v.mean_pairs, v["statistics"] == "thermal"
    missed = 1 - v.heralding_efficiency
    parts = [(1.0, mean)]
    if missed < 1:
        if is_thermal:
            share = 1 / (1 + mean * (1 - missed))
            less = mean * missed * share
        else:
            share, less = float(np.exp(-mean * (1 - missed))), mean * missed
        parts += [(-share, less), (share, 0.0)]
    if not is_thermal:
        return parts
    means, weights = np.polynomial.laguerre.laggauss(NODES)
    return [
        (part * float(weight), mean * float(each))
        for part, mean in parts
        for each, weight in zip(means, weights, strict=True)
    ]


@lru_cache(maxsize=16)  # several measures of a point ask for it
def _of_mixture(
    mixture: tuple[tuple[float, float], ...], seen: float, basis: int
) -> tuple[float, float]:
    formula, announced, wrong = (relay_theory.rectilinear, relay_theory.diagonal)[basis], 0.0, 0.0
    for (one, a), (other, b) in product(mixture, repeat=2):
        gain, errs = formula(a * seen, b * seen, DARK_COUNT, ERROR)
        announced, wrong = announced + one * other * gain, wrong + one * other * errs
    return announced, wrong


def _single(v: Point) -> float:
    mean, seen = v.mean_pairs, v.heralding_efficiency or 1.0
    one = mean / (1 + mean) ** 2 if v["statistics"] == "thermal" else mean * np.exp(-mean)
    return float(one * seen)
