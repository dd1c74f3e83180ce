"""Bounds of single photons at both ends of a relay, against yields that are known."""

from itertools import product
from math import comb, exp, factorial

import numpy as np
import pytest
from numpy.typing import NDArray

from applications.qkd.decoy import Decoys
from applications.qkd.relayed_decoys import TERMS, PairSifted, bounds, expected, key_length
from evidence.curves.relay_theory import (
    decoy_key,
    diagonal,
    endless_key,
    rectilinear,
    single_photons,
)

ALICE, BOB = Decoys((0.4, 0.05, 0.0)), Decoys((0.48, 0.06, 0.001))
DARK, ERROR = 1e-6, 0.015
PULSES = 1e12
SHARES = np.outer(ALICE.shares, BOB.shares)


def counted(a: float, b: float, ends: tuple[Decoys, Decoys] = (ALICE, BOB)) -> PairSifted:
    """Return the counts of the closed forms; a, b: how likely a photon of either end is seen."""
    tables = [
        np.array(
            [[formula(m * a, n * b, DARK, ERROR) for n in ends[1].means] for m in ends[0].means]
        )
        for formula in (rectilinear, diagonal)
    ]
    key, test = (table * SHARES[..., None] * PULSES for table in tables)
    return PairSifted(key[..., 0], test[..., 0], test[..., 1])


@pytest.mark.parametrize(("a", "b"), [(0.9, 0.9), (0.1, 0.1), (0.3, 0.2)])
def test_bounds_hold_and_are_close(a: float, b: float) -> None:
    """Of lasers, where single photons are known to bring what the closed form says."""
    figures, wrong = single_photons(a, b, DARK, ERROR)
    single = ALICE.photons(1) * BOB.photons(1) * figures * PULSES
    found = bounds((ALICE, BOB), counted(a, b), None)
    assert 0.85 * single < found.single <= single
    assert wrong / figures <= found.phase_error < wrong / figures + 0.1


def yields(random: np.random.Generator, most: int = 12) -> NDArray[np.float64]:
    """Return any yields of n and m photons, as an eavesdropper may like them."""
    return random.random((most, most)) ** 4


def counts_of(ends: tuple[Decoys, Decoys], table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the counts of yields, shape (12, 12), by both levels."""
    counts = np.zeros((3, 3))
    for (i, a), (j, b) in product(*(enumerate(end.means) for end in ends)):
        weights = [[exp(-m) * m**n / factorial(n) for n in range(12)] for m in (a, b)]
        share = ends[0].shares[i] * ends[1].shares[j]
        counts[i, j] = share * (np.array(weights[0]) @ table @ np.array(weights[1]))
    return counts * PULSES


@pytest.mark.parametrize("photons", [(1, 2), (2, 1), (2, 2), (1, 3), (3, 1)])
@pytest.mark.parametrize("bright", [0, 1])
def test_pulses_of_several_photons_are_no_single_ones_where_ends_are_unlike(
    photons: tuple[int, int], bright: int
) -> None:
    """An eavesdropper announces nothing but such pulses: none of the bits is of single photons."""
    unlike = Decoys((0.8, 0.05, 0.0)), Decoys((0.2, 0.05, 0.0))
    ends = unlike[bright], unlike[1 - bright]
    table = np.zeros((12, 12))
    table[photons] = 1.0
    counts = counts_of(ends, table)
    assert bounds(ends, PairSifted(counts, counts, counts), None).single <= 1e-9 * counts.sum()


@pytest.mark.parametrize("seed", range(20))
def test_bounds_hold_for_any_yields(seed: int) -> None:
    """An eavesdropper who knows the numbers of photons chooses what is announced, and what errs."""
    random = np.random.default_rng(seed)
    report, share = yields(random), random.random((12, 12))
    tables = [counts_of((ALICE, BOB), table) for table in (report, report, report * share)]
    found = bounds((ALICE, BOB), PairSifted(*tables), None)
    single = ALICE.photons(1) * BOB.photons(1) * report[1, 1] * PULSES
    assert found.single <= single * (1 + 1e-9)
    if found.single > 0:
        assert found.phase_error >= min(0.5, share[1, 1]) - 1e-9


def test_finite_bounds_come_near_those_of_endless_keys() -> None:
    ends, eps = (ALICE, BOB), 1e-10
    for scale, near in ((1.0, 0.99), (1e-2, 0.85)):
        counts = PairSifted(*(table * scale for table in vars(counted(0.9, 0.9)).values()))
        endless, finite = bounds(ends, counts, None), bounds(ends, counts, eps)
        assert near * endless.single < finite.single < endless.single
        assert finite.phase_error > endless.phase_error
    few = PairSifted(*(table * 1e-7 for table in vars(counted(0.9, 0.9)).values()))
    assert key_length(ends, few, 0, eps, 1e-15) == 0


def test_expectations_are_missed_as_rarely_as_is_said() -> None:
    """The tails of a binomial distribution, exactly, at both ends of the announced interval."""
    n, p, eps = 400, 0.05, 1e-3
    chances = [comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(n + 1)]
    low, high = expected(np.arange(n + 1), eps)
    assert sum(c for c, least in zip(chances, low, strict=True) if least > n * p) <= eps
    assert sum(c for c, most in zip(chances, high, strict=True) if most < n * p) <= eps
    assert sum(c for c, least in zip(chances, low, strict=True) if least > n * p) > 0


@pytest.mark.parametrize("vacuum", [0.0, 0.001, 0.01])
def test_a_vacuum_that_is_not_dark_costs_little_of_the_key_of_known_photon_numbers(
    vacuum: float,
) -> None:
    means, seen, correction = (0.4, 0.05, vacuum), 0.3, 1.16
    in_z, in_x = (
        {
            (i, j): formula(m * seen, n * seen, DARK, ERROR)
            for (i, m), (j, n) in product(enumerate(means), enumerate(means))
        }
        for formula in (rectilinear, diagonal)
    )
    endless = endless_key(means[0], seen, DARK, ERROR, correction)
    assert 0.7 * endless < decoy_key(means, in_z, in_x, correction) < endless


def test_the_closed_form_of_endless_decoys_is_an_upper_limit() -> None:
    """Lo, Curty and Qi's key of signals, with photon numbers known, beside that of two decoys."""
    mean, a = 0.4, 0.5
    ends = Decoys((mean, 0.01, 0.0)), Decoys((mean, 0.01, 0.0))
    found = bounds(ends, counted(a, a, ends), None)
    of_signals = (0.5 * mean * exp(-mean)) ** 2 / (ends[0].photons(1) * ends[1].photons(1))
    gain, wrong = rectilinear(mean * a, mean * a, DARK, ERROR)
    entropy = -sum(x * np.log2(x) for x in (wrong / gain, 1 - wrong / gain))
    key = found.secret * of_signals / (0.25 * PULSES) - 1.16 * gain * entropy
    assert key == pytest.approx(endless_key(mean, a, DARK, ERROR, 1.16), rel=0.05)
    assert key < endless_key(mean, a, DARK, ERROR, 1.16)
    assert TERMS == 27
