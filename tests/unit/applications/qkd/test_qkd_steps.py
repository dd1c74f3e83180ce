"""The steps of key distribution one by one, against formulas and slow ways to do the same."""

import hashlib
from collections import Counter
from itertools import product
from math import ceil, comb, exp, lgamma, log, log1p

import numpy as np
import pytest
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes
from qkd_ends import bb84, random_bits
from scipy.fft import next_fast_len
from scipy.stats import binom

from applications.qkd.amplification import fast_size, seed_bits, toeplitz
from applications.qkd.authentication import collision_probability, key_tag
from applications.qkd.bits import Bits, pack, unpack
from applications.qkd.disclosure import compare, sample_mask, sample_size
from applications.qkd.key_length import (
    ZERO_RATE_QBER,
    asymptotic_fraction,
    asymptotic_key_length,
    binary_entropy,
    finite_key_length,
    most_errors,
    most_tagged,
    sampling_deviation,
)
from applications.qkd.public_randomness import mixed, permutation, subset
from applications.qkd.sifting import Clicks, Prepared, Record, choose
from hosts.middleware.session.estimation import Estimate
from wire.keyed import KeyedChoices
from wire.outcomes import NO_CLICK


def test_bits_are_packed_first_bit_highest() -> None:
    bits = np.array([1, 0, 0, 0, 0, 0, 0, 0, 1], dtype=np.uint8)
    assert pack(bits) == b"\x80\x80"
    assert np.array_equal(unpack(b"\x80\x80", 9), bits)
    with pytest.raises(ValueError, match="9 bits are packed in 2 bytes, not 3"):
        unpack(bytes(3), 9)


def test_sifting_keeps_photons_that_both_saw_in_the_same_basis() -> None:
    alice = Record(*(np.array(row, dtype=np.uint8) for row in ([0, 1, 0, 1, 1], [0, 1, 1, 1, 255])))
    bob = Record(*(np.array(row, dtype=np.uint8) for row in ([0, 1, 1, 1, 1], [0, 0, 1, 255, 1])))
    kept = choose(alice.of(bob.clicked), bob.of(bob.clicked).bases)
    assert kept.tolist() == [True, True, False, False]
    assert alice.of(bob.clicked[kept]).outcomes.tolist() == [0, 1]
    assert bob.of(bob.clicked[kept]).outcomes.tolist() == [0, 0]


def test_what_is_known_of_clicks_is_that_of_every_photon() -> None:
    bases, outcomes = np.array([[0, 1, 1, 1, 1], [0, 0, 1, 255, 1]], np.uint8)
    every = Record(bases, outcomes)
    few = Clicks(5, every.clicked, every.of(every.clicked))
    assert few.clicked.tolist() == [0, 1, 2, 4]
    assert few.of(few.clicked.copy()) is few.detected  # nothing is looked up
    for photons in ([], [3], [0, 2, 3], [0, 1, 2, 3, 4]):
        asked = few.of(np.array(photons, np.int64))
        assert asked.outcomes.tolist() == outcomes[photons].tolist()
        seen = asked.outcomes != NO_CLICK
        assert asked.bases[seen].tolist() == bases[photons][seen].tolist()


def test_states_of_a_key_are_any_alike_and_have_levels_by_their_shares() -> None:
    choices = KeyedChoices(bytes(range(16)), 1 << 40, (0.5, 0.35, 0.15))
    at = np.arange(1 << 39, (1 << 39) + 100_000)
    prepared, states = Prepared(choices).of(at), choices.states(at)
    assert np.array_equal(prepared.bases * 2 + prepared.outcomes, states)
    assert prepared.levels is not None
    for state in range(4):
        for level, share in enumerate(choices.shares):
            count = int(((states == state) & (prepared.levels == level)).sum())
            expected = at.size * share / 4
            assert abs(count - expected) < 5 * expected**0.5


def test_half_of_the_photons_that_arrive_are_sifted() -> None:
    rng = np.random.default_rng(1)
    alice, bob = bb84(rng, 100_000, noise=0.0, loss=0.3)
    clicked = bob.clicked
    sifted = clicked[choose(alice.of(clicked), bob.bases[clicked])]
    expected = 100_000 * 0.7 / 2
    assert abs(sifted.size - expected) < 5 * (100_000 * 0.35 * 0.65) ** 0.5
    same = alice.outcomes[sifted] == bob.outcomes[sifted]
    assert same.all()


def test_a_werner_pair_of_fidelity_f_has_a_qber_of_two_thirds_of_what_it_lacks() -> None:
    """Depolarising: X, Y, Z with (1 - F) / 3 each; two of the three flip an outcome."""
    rng = np.random.default_rng(2)
    fidelity, photons = 0.9, 200_000
    bases, bits = random_bits(rng, photons), random_bits(rng, photons)
    pauli = rng.choice(4, photons, p=[fidelity] + [(1 - fidelity) / 3] * 3)  # I, X, Y, Z
    flips = np.where(bases == 0, (pauli == 1) | (pauli == 2), (pauli == 3) | (pauli == 2))
    estimate = compare(bits, bits ^ flips.astype(np.uint8))
    qber = 2 * (1 - fidelity) / 3
    assert abs(estimate.qber - qber) < 5 * (qber * (1 - qber) / photons) ** 0.5


def test_a_sample_is_of_its_size_and_as_likely_at_every_place() -> None:
    counts = np.zeros(50)
    for number in range(2000):
        mask = sample_mask(number.to_bytes(32, "big"), 50, 10)
        assert mask.sum() == 10
        counts += mask
    assert np.abs(counts - 400).max() < 5 * (2000 * 0.2 * 0.8) ** 0.5


def test_a_sample_leaves_something_or_is_none() -> None:
    assert sample_size(1000, 0.1) == 100
    assert sample_size(3, 0.01) == 1
    assert [sample_size(bits, 0.5) for bits in (0, 1, 2)] == [0, 0, 1]


def test_the_confidence_interval_covers_the_true_rate_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    sessions, size, qber = 4000, 500, 0.03
    intervals = [
        Estimate(int(errors), size).interval(0.95) for errors in rng.binomial(size, qber, sessions)
    ]
    covered = sum(low <= qber <= high for low, high in intervals) / sessions
    assert 0.93 < covered < 0.98
    low, high = Estimate(5, 100).interval()
    assert (low, high) == pytest.approx((0.02154, 0.11175), abs=1e-5)  # Wilson score, z = 1.96
    # Of no errors in n it is 0 to z^2 / (n + z^2), and of errors alone the rest of that.
    (low, high), (below, above) = Estimate(0, 100).interval(), Estimate(100, 100).interval()
    assert (high, below) == pytest.approx((0.036994, 0.963006), abs=1e-6)
    assert (low, above) == (0.0, 1.0)


def test_samples_of_different_sizes_cannot_be_compared() -> None:
    with pytest.raises(ValueError, match="samples of 3 and 2 bits"):
        compare(np.zeros(3, dtype=np.uint8), np.zeros(2, dtype=np.uint8))


def test_the_asymptotic_fraction_is_zero_at_eleven_percent() -> None:
    assert asymptotic_fraction(0.0) == 1.0
    assert asymptotic_fraction(0.03) == pytest.approx(1 - 2 * 0.194392, abs=1e-6)
    assert asymptotic_fraction(ZERO_RATE_QBER + 0.0001) == 0.0
    assert 0 < asymptotic_fraction(ZERO_RATE_QBER - 0.0001) < 2e-3
    assert asymptotic_key_length(1000, 0.03, 250) == int(1000 * (1 - 0.194392) - 250)


def test_the_finite_key_bound_is_that_of_tomamichel_and_others() -> None:
    """Equations 1 and 2 of arXiv:1103.4130, worked out with decimal numbers of 40 digits.

    No error in 10,000 of 100,000 bits: (1 - e^(-2 ln(4/eps) / 10,000)) 10/9 of the others at most.
    """
    deviation = sampling_deviation(90_000, 10_000, 1e-10)
    assert deviation == pytest.approx(0.0520838923, abs=1e-10)
    errors = most_errors(90_000, 10_000, 0.0, 1e-10)
    assert errors == pytest.approx(0.0054116993064295888, abs=1e-15)
    assert binary_entropy(errors) == pytest.approx(0.0485347541657412, abs=1e-13)
    assert finite_key_length(90_000, 10_000, 0.0, 19_000, 1e-10, 1e-15) == 66_514


@pytest.mark.parametrize(
    ("key_bits", "sample_bits", "errors"),
    [(90_000, 10_000, 300), (900_000, 100_000, 1000), (27_000, 3000, 0), (9000, 1000, 50)],
)
def test_the_error_rate_of_a_key_is_bounded_by_the_hypergeometric_distribution(
    key_bits: int, sample_bits: int, errors: int
) -> None:
    """scipy sums its tail: below the chance that is allowed, and not below that by much."""
    from scipy.stats import hypergeom  # takes a second, which only this test needs

    eps = 1e-10
    bound = most_errors(key_bits, sample_bits, errors / sample_bits, eps)

    def tail(in_key: int) -> float:
        bits = key_bits + sample_bits
        return float(hypergeom.logcdf(errors, bits, in_key + errors, sample_bits))

    allowed = 2 * log(eps / 4)
    assert tail(ceil(bound * key_bits)) <= allowed < tail(int(0.9 * bound * key_bits))
    assert bound < errors / sample_bits + sampling_deviation(key_bits, sample_bits, eps)


def test_of_a_sample_that_is_most_of_the_bits_serflings_bound_is_the_less() -> None:
    sample, key = 90_000, 10_000
    deviation = sampling_deviation(key, sample, 1e-10)
    assert most_errors(key, sample, 0.05, 1e-10) == 0.05 + deviation


def test_there_is_no_finite_key_of_few_bits_or_much_noise() -> None:
    assert finite_key_length(1000, 100, 0.0, 0, 1e-10, 1e-15) == 0
    assert finite_key_length(900_000, 100_000, 0.11, 500_000, 1e-10, 1e-15) == 0
    assert finite_key_length(0, 10, 0.0, 0, 1e-10, 1e-15) == 0


def test_the_finite_key_fraction_approaches_the_asymptotic_one() -> None:
    fractions = []
    for bits in (10**5, 10**7, 10**9, 10**11):
        leaked = int(bits * binary_entropy(0.02))
        fractions.append(finite_key_length(bits, bits, 0.02, leaked, 1e-10, 1e-15) / bits)
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(asymptotic_fraction(0.02), abs=1e-3)


@pytest.mark.parametrize(
    ("qber", "single", "fraction"),
    [
        # W (1 - h(Q / W)) - h(Q) of Gottesman and others, quant-ph/0212066: worked out by hand with
        # h(.02) = .1414405, h(.03) = .1943919, h(.1) = .4689956.
        (0.02, 1.0, 0.7171190),
        (0.02, 2 / 3, 2 / 3 * (1 - 0.1943919) - 0.1414405),
        (0.02, 0.2, 0.0),  # .2 (1 - .4689956) is less than what error correction tells
        (0.0, 0.5, 0.5),
        (0.0, 0.0, 0.0),
    ],
)
def test_pulses_of_several_photons_cost_the_fraction_of_gllp(
    qber: float, single: float, fraction: float
) -> None:
    assert asymptotic_fraction(qber, single) == pytest.approx(fraction, abs=1e-6)


def test_tags_are_bounded_by_the_tail_of_the_binomial_distribution() -> None:
    """Bernstein's bound is above the exact tail (summed here), and by less than a tenth."""
    pulses, multi_photon, eps = 200_000, 0.01, 1e-10
    tagged = most_tagged(pulses, multi_photon, eps)
    p = multi_photon / 2
    tail, count = 1.0, 0
    while tail > eps:
        logs = lgamma(pulses + 1) - lgamma(count + 1) - lgamma(pulses - count + 1)
        tail -= exp(logs + count * log(p) + (pulses - count) * log1p(-p))
        count += 1
    assert count <= tagged < 1.1 * count
    assert most_tagged(pulses, 0.0, eps) == 0


@pytest.mark.parametrize("pulses", [100, 10_000, 10_000_000])
@pytest.mark.parametrize("mean", [0.01, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("eps", [1e-3, 1e-10, 1e-15])
def test_few_pulses_of_several_photons_exceed_their_bound_as_rarely_as_is_said(
    pulses: int, mean: float, eps: float
) -> None:
    """By the binomial distribution itself, of such pulses in the right basis: half of all."""
    multi_photon = 2 * mean / pulses
    tagged = most_tagged(pulses, multi_photon, eps)
    assert binom.sf(np.floor(tagged), pulses, multi_photon / 2) <= eps


def test_no_finite_key_is_made_of_bits_that_are_all_known() -> None:
    assert finite_key_length(90_000, 10_000, 0.0, 0, 1e-10, 1e-15, tagged_bits=90_000) == 0
    assert finite_key_length(90_000, 10_000, 0.0, 0, 1e-10, 1e-15, tagged_bits=1e6) == 0
    some = finite_key_length(90_000, 10_000, 0.0, 0, 1e-10, 1e-15, tagged_bits=9_000)
    # .9 (1 - h(.0054116993 / .9)) of 90,000, less log2(2 / 1e-35): h(.0060129992) = .0530109.
    assert some == pytest.approx(81_000 * (1 - 0.0530109) - 117.27, abs=2)


def naive_toeplitz(key: Bits, seed: Bits, length: int) -> Bits:
    """Return the product of the key and the matrix (T, I) itself."""
    others = key.size - length
    places = np.arange(length)[:, None] - np.arange(others)[None, :] + others - 1
    matrix = np.hstack([seed[places], np.eye(length, dtype=np.uint8)])
    shortened: Bits = (matrix.astype(np.int64) @ key % 2).astype(np.uint8)
    return shortened


@pytest.mark.parametrize("key_bits", [1, 2, 7, 64, 1000])
def test_toeplitz_hashing_by_fft_equals_the_matrix_product(key_bits: int) -> None:
    rng = np.random.default_rng(key_bits)
    for length in {1, key_bits // 2, key_bits - 1, key_bits} - {0}:
        key, seed = random_bits(rng, key_bits), random_bits(rng, seed_bits(key_bits))
        assert np.array_equal(toeplitz(key, seed, length), naive_toeplitz(key, seed, length))
    assert toeplitz(key, seed, 0).size == 0


def test_two_keys_of_four_bits_collide_under_no_more_matrices_than_chance_has_it() -> None:
    """All 8 matrices of 2 rows, all 15 differences: two-universal is at most a quarter of them."""
    seeds = [np.array(seed, dtype=np.uint8) for seed in product((0, 1), repeat=3)]
    for difference in product((0, 1), repeat=4):
        key = np.array(difference, dtype=np.uint8)
        if key.any():
            assert sum(not toeplitz(key, seed, 2).any() for seed in seeds) <= len(seeds) / 4


def test_sizes_of_transforms_are_those_that_scipy_chooses() -> None:
    for least in (*range(1, 2000), 99_999, 123_457, 1_000_001, 2**20 - 1, 2**20, 2**20 + 1):
        assert fast_size(least) == next_fast_len(least, real=True)


@pytest.mark.parametrize("ones", [0.5, 1.0])
def test_toeplitz_hashing_of_a_million_bits_is_exact(ones: float) -> None:
    rng = np.random.default_rng(5)
    key_bits, length = 1 << 20, 1 << 19
    key = np.ones(key_bits, dtype=np.uint8)  # the largest sums there can be
    seed = (rng.random(seed_bits(key_bits)) < ones).astype(np.uint8)
    out = toeplitz(key, seed, length)
    others = np.ones(key_bits - length, np.int64)
    for begin in (0, length // 2 - 50, length - 100):  # of the key; its halves are made together
        part = seed.astype(np.int64)[begin : begin + others.size + 99]
        sums = np.convolve(part, others, "valid")
        assert np.array_equal(out[begin : begin + 100], (sums + 1) % 2)


def test_a_seed_of_the_wrong_size_is_refused() -> None:
    key = np.zeros(8, dtype=np.uint8)
    with pytest.raises(ValueError, match="a seed of 10 bits, not 7"):
        toeplitz(key, np.zeros(10, dtype=np.uint8), 4)
    with pytest.raises(ValueError, match="9 bits cannot be made of 8"):
        toeplitz(key, np.zeros(7, dtype=np.uint8), 9)


def test_keys_that_differ_in_one_bit_or_in_length_have_different_tags() -> None:
    rng = np.random.default_rng(6)
    key, hash_key = random_bits(rng, 1001), rng.bytes(32)
    tags = {key_tag(key, hash_key), key_tag(key[:-1], hash_key)}
    for place in range(key.size):
        key[place] ^= 1
        tags.add(key_tag(key, hash_key))
        key[place] ^= 1
    assert len(tags) == key.size + 2


def test_different_keys_hardly_ever_have_the_same_tag() -> None:
    assert collision_probability(1 << 20) < 2**-89


def test_a_permutation_is_the_same_on_every_machine() -> None:
    """That of `openssl dgst -shake256` and `openssl enc -aes-256-ctr`."""
    assert permutation(bytes(32), "cascade 0", 8).tolist() == [4, 7, 5, 2, 0, 3, 6, 1]
    assert sorted(permutation(bytes(32), "sample", 1000).tolist()) == list(range(1000))
    with pytest.raises(ValueError, match="a seed has 32 bytes, not 31"):
        permutation(bytes(31), "sample", 8)


def test_a_photon_that_did_not_click_says_nothing() -> None:
    record = Record(np.zeros(2, dtype=np.uint8), np.array([NO_CLICK, 1], dtype=np.uint8))
    assert record.clicked.tolist() == [1]


@pytest.mark.parametrize("size", [1, 2, 3, 5, 8, 1000, 1024, 1025, 40_000])
def test_orders_of_cascade_are_permutations(size: int) -> None:
    orders = [mixed(bytes(32), f"cascade {number}", size) for number in range(3)]
    for order in orders:
        assert np.array_equal(np.sort(order), np.arange(size))
    if size > 100:
        assert not np.array_equal(orders[0], orders[1])


def test_bits_of_one_block_are_parted_by_the_next_order_as_by_chance() -> None:
    """Of two orders: pairs in a block of 16 of both, n (15/2) 15/(n - 1) of all; 100 orders."""
    size, block, orders = 32_768, 16, 100
    places = np.zeros((2, size), np.int64)
    together = 0
    for number in range(orders):
        for which in (0, 1):
            order = mixed(bytes(32), f"cascade {2 * number + which}", size)
            places[which, order] = np.arange(size) // block
        both = places[0] * size + places[1]
        _values, counts = np.unique(both, return_counts=True)
        together += int((counts * (counts - 1) // 2).sum())
    expected = orders * size * (block - 1) / 2 * (block - 1) / (size - 1)
    assert abs(together - expected) < 5 * expected**0.5


def test_every_place_is_taken_by_any_bit() -> None:
    """Where bit 0 comes to, of 4,000 orders of 16: each place within 5 sigma of its share."""
    places = [
        int(np.flatnonzero(mixed(bytes(32), f"cascade {number}", 16) == 0)[0])
        for number in range(4_000)
    ]
    counts = np.bincount(places, minlength=16)
    assert (abs(counts - 250) < 5 * (250 * 15 / 16) ** 0.5).all()


def test_a_sample_is_of_the_first_places_that_a_stream_draws() -> None:
    """Word by word: those below a multiple of the size, each place as often as it comes again."""
    for size, count in ((10, 1), (10, 5), (10, 9), (1000, 137), (1000, 901)):
        words = iter(stream_of_words(bytes(32), b"sample"))
        drawn: set[int] = set()
        while len(drawn) < min(count, size - count):
            word = next(words)
            if word < 2**32 - 2**32 % size:
                drawn.add(word % size)
        chosen = set(np.flatnonzero(subset(bytes(32), "sample", size, count)).tolist())
        assert chosen == (drawn if 2 * count <= size else set(range(size)) - drawn)
    assert not subset(bytes(32), "sample", 10, 0).any()
    assert subset(bytes(32), "sample", 10, 10).all()


def stream_of_words(seed: bytes, purpose: bytes) -> list[int]:
    """Return the first words of AES-256 in counter mode."""
    drawn = hashlib.shake_256(seed + purpose).digest(48)
    words = (
        Cipher(algorithms.AES(drawn[:32]), modes.CTR(drawn[32:])).encryptor().update(bytes(8000))
    )
    return [int.from_bytes(words[at : at + 4], "little") for at in range(0, len(words), 4)]


@pytest.mark.parametrize(("size", "count"), [(5, 2), (5, 3), (7, 3)])
def test_all_samples_are_as_likely(size: int, count: int) -> None:
    """Of 4,000 seeds: each of the possible ones within 5 sigma of its share."""
    found = Counter(
        tuple(np.flatnonzero(subset(seed.to_bytes(32, "big"), "sample", size, count)).tolist())
        for seed in range(4_000)
    )
    share = 1 / comb(size, count)
    assert len(found) == comb(size, count)
    for times in found.values():
        assert abs(times - 4_000 * share) < 5 * (4_000 * share * (1 - share)) ** 0.5
