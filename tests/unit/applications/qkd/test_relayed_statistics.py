"""Finite keys by way of a relay: against linear programs, and light that is counted many times."""

from collections.abc import Callable
from itertools import product
from math import factorial

import numpy as np
import pytest
from numpy.typing import NDArray

from applications.qkd.decoy import Decoys, phase_error
from applications.qkd.key_length import binary_entropy
from applications.qkd.relayed_decoys import TERMS, PairSifted, bounds, expected
from evidence.curves.relay_theory import diagonal, rectilinear, single_photons

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST = 12  # photons of a pulse that are distinguished
DARK, ERROR = 6.02e-6, 0.015  # of Curty and others, as are .2 dB/km and an efficiency of 14.5 %
PULSES = 1e13


def chances(ends: tuple[Decoys, Decoys]) -> Floats:
    """Return how likely pulses are of both levels and have n and m photons; (3, 3, n, m)."""
    one, other = (
        np.array(
            [
                [share * np.exp(-mean) * mean**n / factorial(n) for n in range(MOST)]
                for mean, share in zip(end.means, end.shares, strict=True)
            ]
        )
        for end in ends
    )
    found: Floats = np.einsum("an,bm->abnm", one, other)
    return found


def extreme(ends: tuple[Decoys, Decoys], counts: Floats, eps: float, sign: int) -> float:
    """Return the least (sign 1) or the most bits (-1) of one photon each that fit nine counts.

    Of all yields that an eavesdropper may choose, with what Poisson distributions may have had as
    means, exactly: no bound that follows from these counts can tell more.
    """
    from scipy.optimize import linprog  # takes a second, which few tests need
    from scipy.stats import gamma

    likely = chances(ends)
    shares = (likely / likely.sum(axis=(0, 1))).reshape(9, -1)  # of levels, given photons
    x = counts.ravel()
    low, high = gamma.ppf(eps, x), gamma.isf(eps, x + 1)
    rows = shares / high[:, None] * x.sum()
    aim = np.zeros((MOST, MOST))
    aim[1, 1] = sign
    answer = linprog(
        aim.ravel(),
        A_ub=np.vstack([rows, -rows]),
        b_ub=np.concatenate([np.ones(9), -low / high]),
        method="highs",
    )
    assert answer.status == 0, answer.message
    return float(sign * answer.fun * x.sum())


@pytest.mark.parametrize("length_km", [0.0, 50.0, 75.0])
@pytest.mark.parametrize("means", [(0.4, 0.1, 0.0), (0.3, 0.07, 5e-4)])
def test_no_more_is_told_than_linear_programs_allow(
    length_km: float, means: tuple[float, ...]
) -> None:
    """Nor much less; and single photons bring what the closed form says, which is in between."""
    end = Decoys(means, (0.5, 0.35, 0.15))
    ends, eps_sec = (end, end), 1e-10
    arrives = 0.145 * 10 ** (-0.01 * length_km)
    each = np.outer(end.shares, end.shares) * PULSES / 4
    key, tested = (
        np.array([[formula(a * arrives, b * arrives, DARK, ERROR) for b in means] for a in means])
        * each[..., None]
        for formula in (rectilinear, diagonal)
    )
    figures, errs = single_photons(arrives, arrives, DARK, ERROR)
    true = end.photons(1) ** 2 * PULSES / 4 * figures
    found = bounds(ends, PairSifted(key[..., 0], tested[..., 0], tested[..., 1]), eps_sec)
    eps = eps_sec / TERMS
    single, test = (extreme(ends, table[..., 0], eps, 1) for table in (key, tested))
    wrong = extreme(ends, tested[..., 1], eps, -1)
    assert 0.9 * single < found.single <= single <= true
    assert errs / figures <= wrong / test < found.phase_error < 1.15 * wrong / test
    most = single * (1 - binary_entropy(wrong / test))
    assert 0.85 * most < found.secret < most


TRIALS = 2000
FEW = Decoys((0.4, 0.1, 0.01), (0.4, 0.4, 0.2))


def drawn(random: np.random.Generator, photons: Counts) -> Counts:
    """Return how many bits of each two levels there are, by how many are of n and m photons.

    Of each bit the levels are drawn by what the photons leave open; shapes (TRIALS, n, m) and
    (TRIALS, 3, 3).
    """
    likely = chances((FEW, FEW))
    shares = (likely / likely.sum(axis=(0, 1))).reshape(9, MOST, MOST)
    counts = np.zeros((TRIALS, 9), np.int64)
    for n, m in np.ndindex(MOST, MOST):
        counts += random.multinomial(photons[:, n, m], shares[:, n, m])
    return counts.reshape(TRIALS, 3, 3)


def seen(scale: float) -> Counts:
    """Return bits by photons: each of 30 % arrives, half of two are announced, a few have none."""
    one = 1 - 0.7 ** np.arange(MOST) + 1e-3
    likely = chances((FEW, FEW)).sum(axis=(0, 1))
    bits = np.round(scale * likely * np.outer(one, one) / 2).astype(np.int64)
    return np.repeat(bits[None], TRIALS, axis=0)


def test_a_mean_is_missed_as_rarely_as_is_said() -> None:
    """Each of nine counts, whose bits are not equally likely: 5 % at either end, at most."""
    random, eps = np.random.default_rng(1), 0.05
    photons = seen(1e6)
    likely = chances((FEW, FEW))
    means = (likely / likely.sum(axis=(0, 1)) * photons[0]).sum(axis=(2, 3))
    low, high = expected(drawn(random, photons), eps)
    spread = 5 * np.sqrt(eps / TRIALS)
    for missed in ((low > means).mean(axis=0), (high < means).mean(axis=0)):
        assert (missed < eps + spread).all()
        assert missed.max() > eps / 20


@pytest.mark.nightly
@pytest.mark.parametrize("errs", [0.0, 0.02, 0.2])
def test_bounds_fail_no_more_often_than_eps_says(errs: float) -> None:
    """Without a margin for chance they fail often. Which bits are tested, and err, is by chance."""
    random, eps = np.random.default_rng(2), 0.05
    photons = seen(3e6)
    single = int(photons[0, 1, 1])
    wrong = np.round(photons * errs).astype(np.int64)
    both = 2 * wrong[0, 1, 1]
    phases = random.hypergeometric(both, 2 * single - both, single, TRIALS)
    wrong[:, 1, 1] = both - phases
    keys, errors = drawn(random, photons), drawn(random, wrong)
    tests = errors + drawn(random, photons - wrong)
    failed = {True: 0, False: 0}
    for key, test, error, phase in zip(keys, tests, errors, phases, strict=True):
        for finite in failed:
            found = bounds((FEW, FEW), PairSifted(key, test, error), eps if finite else None)
            failed[finite] += found.single > single or found.phase_error < phase / single
    assert failed[True] <= eps * TRIALS
    assert failed[False] > 0.2 * TRIALS


@pytest.mark.parametrize("bob", [FEW, Decoys((0.5, 0.06, 0.001), (0.6, 0.3, 0.1))])
def test_finite_bounds_are_the_worst_of_endless_ones_within_all_means(bob: Decoys) -> None:
    """Those are linear in the counts, so that they are worst where each mean is least or most."""
    ends, eps_sec = (FEW, bob), 1e-6
    arrives = 0.3
    tables = np.array(
        [
            [[formula(a * arrives, b * arrives, DARK, ERROR) for b in bob.means] for a in FEW.means]
            for formula in (rectilinear, diagonal)
        ]
    )
    counts = np.round(tables * np.outer(FEW.shares, bob.shares)[..., None] * 1e9)
    key, test, errors = counts[0, ..., 0], counts[1, ..., 0], counts[1, ..., 1]

    def worst(table: Floats, of: Callable[[Floats], float]) -> float:
        ways = np.array(expected(table, eps_sec / TERMS))
        corners = product((0, 1), repeat=9)
        return min(of(np.choose(np.reshape(way, (3, 3)), ways)) for way in corners)

    def single(bits: Floats) -> float:
        return bounds(ends, PairSifted(bits, bits, errors), None).single

    def right(wrong: Floats) -> float:
        return -bounds(ends, PairSifted(test, test, wrong), None).phase_error * single(test)

    found = bounds(ends, PairSifted(key, test, errors), eps_sec)
    least, tested, wrong = worst(key, single), worst(test, single), -worst(errors, right)
    assert 0 < least < 0.99 * single(key)
    assert found.single == pytest.approx(least, rel=1e-9)
    phases = phase_error(least, tested, wrong, eps_sec / TERMS)
    assert found.phase_error == pytest.approx(phases, rel=1e-4)
    assert -right(errors) < 0.9 * wrong
