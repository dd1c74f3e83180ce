"""Decoy states: against an independent program, the paper's figures, and photons; seed 1."""

from dataclasses import replace
from math import ceil, exp, floor, log, log2, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from qkd_ends import SHORT, make_ends, measured, random_bits

from applications.qkd.bits import pack_levels, unpack_levels
from applications.qkd.decoy import Bounds, Decoys, Sifted, bounds, key_length, phase_error
from applications.qkd.end import State
from applications.qkd.messages import Bound, Intensities, unframe
from applications.qkd.sifting import Record
from wire.outcomes import NO_CLICK

Floats = NDArray[np.float64]
PULSES = 2_000_000
DECOYS = Decoys((0.5, 0.1, 0.0), (0.5, 0.3, 0.2))

# Of https://github.com/KlenM/Finite-key-Decoy-state-QKD (class DecoyStateFinite, f_EC = 0).
ELSEWHERE = [
    (
        Decoys((0.5, 0.1, 0.0002), (0.5, 0.35, 0.15)),
        ([412345, 58901, 350], [401234, 57890, 330], [4050, 590, 150]),
        (1e-10, 1e-15),
        200133,
    ),
    (
        Decoys((0.6, 0.2, 0.0), (0.7, 0.2, 0.1)),
        ([5_000_000, 520_000, 900], [1_000_000, 104_000, 180], [12000, 1250, 88]),
        (1e-9, 1e-12),
        2597058,
    ),
    (
        Decoys((0.4, 0.1, 0.01), (0.5, 0.3, 0.2)),
        ([90_000, 14_000, 1200], [88_000, 13_900, 1180], [880, 150, 40]),
        (1e-10, 1e-15),
        32538,
    ),
]


def gamma(eps: float, rate: float, tested: float, single: float) -> float:
    """Return the paper's gamma, for random sampling, of equation 5."""
    c, d = tested, single
    odds = (c + d) / (c * d * (1 - rate) * rate) * 21**2 / eps**2
    return sqrt((c + d) * (1 - rate) * rate / (c * d * log(2)) * log2(odds))


def published(
    decoys: Decoys, counts: tuple[list[int], ...], eps_sec: float, eps_cor: float
) -> tuple[float, float, float, float]:
    """Return s_0, s_1, phi and the length of a key by equations 1 to 5, number for number."""
    mu1, mu2, mu3 = decoys.means
    tau0, tau1 = (
        sum(p * exp(-mu) * mu**n for p, mu in zip(decoys.shares, decoys.means, strict=True))
        for n in (0, 1)
    )

    def corrected(numbers: list[int]) -> list[tuple[float, float]]:
        spread = sqrt(sum(numbers) / 2 * log(21 / eps_sec))
        weights = [exp(mu) / p for p, mu in zip(decoys.shares, decoys.means, strict=True)]
        pairs = zip(weights, numbers, strict=True)
        return [(w * max(0.0, n - spread), w * (n + spread)) for w, n in pairs]

    def of_no_and_one_photon(numbers: list[int]) -> tuple[float, float]:
        (_least, n1), (least2, n2), (least3, n3) = corrected(numbers)
        s0 = max(0.0, tau0 * (mu2 * least3 - mu3 * n2) / (mu2 - mu3))
        s1 = least2 - n3 - (mu2**2 - mu3**2) / mu1**2 * (n1 - s0 / tau0)
        return s0, tau1 * mu1 * s1 / (mu1 * (mu2 - mu3) - mu2**2 + mu3**2)

    (s0, s1), (_z0, z1) = (of_no_and_one_photon(numbers) for numbers in counts[:2])
    errors = corrected(counts[2])
    v1 = tau1 * (errors[1][1] - errors[2][0]) / (mu2 - mu3)
    phi = v1 / z1 + gamma(eps_sec, v1 / z1, z1, s1)
    entropy = -phi * log2(phi) - (1 - phi) * log2(1 - phi)
    cost = 6 * log2(21 / eps_sec) + log2(2 / eps_cor)
    return s0, s1, phi, s0 + s1 * (1 - entropy) - cost


@pytest.mark.parametrize(("decoys", "counts", "eps", "expected"), ELSEWHERE)
def test_keys_are_those_of_the_paper_but_for_the_sampling_of_errors(
    decoys: Decoys, counts: tuple[list[int], ...], eps: tuple[float, float], expected: int
) -> None:
    """An independent program and its equations agree; the exact tail costs 1 % at most."""
    s0, s1, phi, length = published(decoys, counts, *eps)
    assert floor(length) == expected
    sifted = Sifted(*(np.array(each) for each in counts))
    found = bounds(decoys, sifted, eps[0])
    assert (found.vacuum, found.single) == pytest.approx((s0, s1), rel=1e-12)
    assert phi < found.phase_error < 1.05 * phi
    mine = key_length(decoys, sifted, 0, *eps)
    assert 0.99 * expected < mine < expected
    assert mine == floor(found.secret - 6 * log2(21 / eps[0]) - log2(2 / eps[1]))
    assert key_length(decoys, sifted, 1000, *eps) == mine - 1000


@pytest.mark.parametrize(
    ("single", "tested", "wrong"),
    [
        (100_000, 100_000, 0),
        (100_000, 100_000, 1),
        (1_000_000, 100_000, 20),
        (20_000, 300_000, 3000),
        (1_000_000, 1_000_000, 30_000),
    ],
)
def test_phase_errors_are_bounded_by_the_tail_that_scipy_sums(
    single: int, tested: int, wrong: int
) -> None:
    """No more likely than eps^2, and not by much: one error in a hundred fewer would be."""
    from scipy.stats import hypergeom  # takes a second, which few tests need

    eps = 1e-10 / 21

    def tail(in_key: int) -> float:
        return float(hypergeom.logcdf(wrong, single + tested, wrong + in_key, tested))

    bound = round(phase_error(single, tested, wrong, eps) * single)
    assert tail(bound) <= 2 * log(eps) < tail(int(0.99 * bound) - 1)


def test_the_papers_equation_is_not_for_few_errors() -> None:
    """Of 10 errors in half of all bits it bounds the others' but for 3e-9, not 1e-10 / 21."""
    from scipy.stats import hypergeom  # takes a second, which few tests need

    bits, wrong = 100_000, 10
    rate = wrong / bits
    in_key = ceil((rate + gamma(1e-10, rate, bits, bits)) * bits)
    fails = hypergeom.cdf(wrong, 2 * bits, wrong + in_key, bits)
    assert fails == pytest.approx(3e-9, rel=0.2)
    assert phase_error(bits, bits, wrong, 1e-10 / 21) * bits > 1.5 * in_key


def pulses(count: int, transmission: float, split: bool = False) -> tuple[NDArray[np.uint8], ...]:
    """Return levels, photons and which of them bob has seen, counted one by one.

    An eavesdropper who splits keeps a photon of each pulse of several and lets one arrive, and of
    single photons only as many as let bob sees as many pulses of the signal as without her.
    """
    rng = np.random.default_rng(1)
    levels = rng.choice(3, count, p=DECOYS.shares).astype(np.uint8)
    photons = rng.poisson(np.array(DECOYS.means)[levels]).astype(np.uint8)
    seen = rng.random(count) < 1 - (1 - transmission) ** photons.astype(float)
    if split:
        signal = DECOYS.means[0]
        several = 1 - exp(-signal) * (1 + signal)
        let = (1 - exp(-signal * transmission) - several) / (signal * exp(-signal))
        assert let >= 0
        seen = (photons > 1) | ((photons == 1) & (rng.random(count) < let))
    return levels, photons, seen.astype(np.uint8)


def channel_bounds(split: bool, eps_sec: float | None) -> tuple[Bounds, int]:
    """Return the bounds on counts of a channel of .2, and how many were of one photon."""
    rng = np.random.default_rng(2)
    levels, photons, seen = pulses(PULSES, 0.2, split)
    there = seen.astype(bool)
    bases = random_bits(rng, int(there.sum()))
    wrong = rng.random(int((bases == 0).sum())) < 0.01
    sifted = Sifted.counted(levels[there], bases, wrong)
    return bounds(DECOYS, sifted, eps_sec), int((photons[there][bases == 1] == 1).sum())


def test_single_photons_are_bounded_from_below_and_closely() -> None:
    endless, ones = channel_bounds(split=False, eps_sec=None)
    finite, _ones = channel_bounds(split=False, eps_sec=1e-10)
    assert 0.5 * ones < finite.single < endless.single
    assert 0.85 * ones < endless.single < 1.05 * ones
    assert endless.phase_error < finite.phase_error < 0.1


def test_who_splits_photon_numbers_is_found_by_decoys() -> None:
    """The signal is seen as often as before; of the weak pulses too few are."""
    levels, _photons, honest = pulses(PULSES, 0.2)
    _levels, _photons, spied = pulses(PULSES, 0.2, split=True)
    signal = levels == 0
    assert spied[signal].mean() == pytest.approx(honest[signal].mean(), rel=0.01)
    found, ones = channel_bounds(split=True, eps_sec=None)
    unspied, many = channel_bounds(split=False, eps_sec=None)
    assert ones < 0.2 * many
    assert found.single < 0.2 * unspied.single


def light(photons: int) -> tuple[Record, Record]:
    """Return what both ends know of pulses over a channel of .5 with 1 % errors."""
    rng = np.random.default_rng(3)
    levels = rng.choice(3, photons, p=DECOYS.shares).astype(np.uint8)
    several = rng.poisson(np.array(DECOYS.means)[levels])
    bits, bases, own = (random_bits(rng, photons) for _ in range(3))
    outcomes = measured(rng, bits, bases, own)
    outcomes ^= (rng.random(photons) < 0.01).astype(np.uint8)
    outcomes[rng.random(photons) >= 1 - 0.5 ** several.astype(float)] = NO_CLICK
    return Record(bases, bits, levels), Record(own, outcomes)


def test_two_ends_make_the_same_key_of_the_basis_x() -> None:
    blocks = light(900_000)
    parameters = replace(SHORT, bound=Bound.FINITE)
    ends = make_ends(np.random.default_rng(1), parameters, decoys=DECOYS)
    ends.run(blocks)
    assert ends.alice.state is ends.bob.state is State.DONE, ends.alice.failure
    assert ends.alice.key is not None
    assert ends.bob.key is not None
    assert np.array_equal(ends.alice.key, ends.bob.key)
    alices, bobs = blocks
    kept = (bobs.outcomes != NO_CLICK) & (alices.bases == bobs.bases)
    assert alices.levels is not None
    test = alices.bases[kept] == 0
    wrong = (alices.outcomes[kept] != bobs.outcomes[kept])[test]
    sifted = Sifted.counted(alices.levels[kept], alices.bases[kept], wrong)
    report = ends.alice.report
    leaked = report.leaked + 128
    expected = key_length(DECOYS, sifted, leaked, parameters.eps_sec, parameters.eps_cor)
    assert report.key == expected > 0
    assert report.sample == test.sum()
    assert ends.alice.single_share == ends.bob.single_share > 0.2


def test_levels_that_do_not_fit_end_the_session() -> None:
    ends = make_ends(np.random.default_rng(1), decoys=DECOYS)

    def fewer(_number: int, data: bytes) -> list[bytes]:
        return [] if unframe(data).kind == Intensities.KIND else [data]

    ends.change = fewer
    ends.run(light(20_000))
    assert ends.bob.state is State.ABORTED  # the next message is out of its turn
    assert ends.alice.key is None


def test_decoys_without_levels_are_refused() -> None:
    alice = make_ends(np.random.default_rng(1), decoys=DECOYS).alice
    alice.start()
    record = light(100)[0]
    with pytest.raises(ValueError, match="levels are for decoys"):
        alice.add_block(replace(record, levels=None))


def test_levels_are_packed_two_bits_each() -> None:
    levels = np.array([0, 1, 2, 0, 2], np.uint8)
    assert pack_levels(levels) == bytes([0b00011000, 0b10000000])
    assert np.array_equal(unpack_levels(pack_levels(levels), 5), levels)
