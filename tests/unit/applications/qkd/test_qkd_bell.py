"""The CHSH test of two ends back to back, with numpy for the light; seed 1.

Werner pairs of visibility V have E(a, b) = V cos of the angle between the settings, S = 2 sqrt 2 V.
"""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from qkd_ends import SHORT, Ends, make_ends, random_bits

from applications.key_distribution.summary import Counts, some_only
from applications.qkd.bell_test import BellOutcomes, Correlations
from applications.qkd.end import State
from applications.qkd.messages import AbortReason, BellAnswer, BellTest, unframe
from applications.qkd.sifting import Record
from wire.outcomes import NO_CLICK

TESTED = replace(SHORT, chsh_fraction=0.3)
PAIRS = 40_000
ANGLES = np.pi * np.array([0, 1 / 2, 1 / 4, -1 / 4])  # of Z, X, Z+X and Z-X from Z

Bits = NDArray[np.uint8]


def werner(rng: np.random.Generator, visibility: float) -> tuple[Record, Record]:
    """Return what both ends measure of Werner pairs, of which bob tests some and loses some."""
    bases, bits = random_bits(rng, PAIRS), random_bits(rng, PAIRS)
    settings = random_bits(rng, PAIRS)
    tested = rng.random(PAIRS) < TESTED.chsh_fraction
    own = np.where(tested, settings + 2, settings)
    expected = visibility * np.cos(ANGLES[bases] - ANGLES[own])
    outcomes = bits ^ (rng.random(PAIRS) >= (1 + expected) / 2)
    return Record(bases, bits), report(own, outcomes.astype(np.uint8), rng.random(PAIRS) < 0.1)


def report(own: Bits, outcomes: Bits, lost: NDArray[np.bool_]) -> Record:
    """Return bob's record, with his tests apart."""
    tested = own > 1
    seen = tested & ~lost
    hidden = np.where(tested | lost, NO_CLICK, outcomes).astype(np.uint8)
    tests = BellOutcomes(seen, (own[seen] - 2).astype(np.uint8), outcomes[seen])
    return Record(np.where(tested, 0, own).astype(np.uint8), hidden, tests=tests)


def after(visibility: float, margin: float = 0.1) -> Ends:
    ends = make_ends(np.random.default_rng(1), replace(TESTED, chsh_margin=margin))
    ends.run(*(werner(np.random.default_rng(seed), visibility) for seed in (2, 3)))
    return ends


@pytest.mark.parametrize("visibility", [1.0, 0.95])
def test_s_is_that_of_werner_pairs_and_there_is_a_key(visibility: float) -> None:
    ends = after(visibility)
    assert ends.alice.state is ends.bob.state is State.DONE, ends.alice.failure
    for end in (ends.alice, ends.bob):
        assert abs(end.bell.s - 2 * sqrt(2) * visibility) < 5 * end.bell.error
        assert end.bell.error == pytest.approx(
            sqrt(16 * (1 - visibility**2 / 2) / end.bell.pairs), rel=0.05
        )
        assert abs(end.bell.pairs - 0.27 * 2 * PAIRS) < 5 * sqrt(0.27 * 2 * PAIRS)
    assert ends.alice.bell.s == ends.bob.bell.s


def test_at_or_below_two_and_the_margin_there_is_no_key_though_few_bits_are_wrong() -> None:
    """V = .85 has an error rate of 7.5 %, which the threshold allows, and S = 2.40."""
    ends = after(0.85, margin=0.5)
    assert ends.alice.failure is not None
    assert ends.alice.failure.reason is AbortReason.LOCAL
    assert ends.bob.failure is not None
    assert ends.bob.failure.by_peer
    assert ends.alice.key is ends.bob.key is None
    assert after(0.85, margin=0.2).alice.state is State.DONE


def test_s_far_below_two_the_other_way_round_is_no_proof() -> None:
    """Bob's tests have all the wrong sign: S = -2 sqrt 2, and no bit of the key is wrong."""
    ends = make_ends(np.random.default_rng(1), TESTED)
    alice, bob = werner(np.random.default_rng(2), 1.0)
    assert bob.tests is not None
    flipped = replace(bob.tests, bits=bob.tests.bits ^ np.uint8(1))
    ends.run((alice, replace(bob, tests=flipped)))
    assert abs(ends.alice.bell.s + 2 * sqrt(2)) < 5 * ends.alice.bell.error
    assert ends.alice.failure is not None
    assert ends.alice.failure.reason is AbortReason.LOCAL


def test_who_tells_both_ends_the_same_bits_beforehand_reaches_two() -> None:
    """Local hidden variables: all outcomes 0, no error in any basis, S = 1 + 1 + 1 - 1."""
    rng = np.random.default_rng(4)
    own, zeros = rng.integers(0, 4, PAIRS, dtype=np.uint8), np.zeros(PAIRS, np.uint8)
    ends = make_ends(np.random.default_rng(1), replace(TESTED, chsh_margin=0.0))
    ends.run((Record(random_bits(rng, PAIRS), zeros), report(own, zeros, np.zeros(PAIRS, bool))))
    assert ends.alice.bell.s == 2.0
    assert ends.alice.failure is not None
    assert ends.alice.failure.reason is AbortReason.LOCAL


def test_too_few_tests_decide_nothing_and_so_against_a_key() -> None:
    bell = Correlations()
    bell.add(*(np.array(each, np.uint8) for each in ([0, 1, 0], [0, 0, 1], [0, 0, 0])))
    assert bell.pairs == 3
    assert not bell.s > bell.least(0.0)
    for _ in range(3):
        bell.add(*(np.array(each, np.uint8) for each in ([0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 1])))
    assert bell.s == 4
    # The half-width of Wilson's score interval for n outcomes alike: 1 / (n + 1) of E.
    assert bell.error == pytest.approx(sqrt(3 / 5**2 + 1 / 4**2))
    assert not bell.s > bell.least(0.0)
    bell.add(*(np.array([each], np.uint8) for each in (0, 0, 1)))
    assert bell.least(0.0) == pytest.approx(2 + 5 * bell.error)


@pytest.mark.parametrize("tests", [1, 3])
def test_s_without_a_test_in_each_pair_of_settings_is_null(tests: int) -> None:
    """A mean of no outcomes is none: null in JSON (RFC 8259 knows no NaN), as the error of it."""
    counts = Counts()
    counts.bell.add(*np.array([[0, 1, 0], [0, 0, 1], [0, 0, 0]], np.uint8)[:, :tests])
    expected = {"chsh": None, "chsh_error": None, "chsh_pairs": tests}
    assert some_only(counts) == expected
    counts.bell.add(*np.array([[1, 0, 1], [1, 1, 0], [0, 0, 0]], np.uint8))
    assert some_only(counts)["chsh"] == 2  # 1 + 1 + 1 - 1


def test_too_few_tests_end_a_key_with_the_count_and_no_nan() -> None:
    """None of the four pairs of settings alone: alice's bases are all Z."""
    alices, bobs = werner(np.random.default_rng(2), 1.0)
    ends = make_ends(np.random.default_rng(1), TESTED)
    ends.run((replace(alices, bases=np.zeros_like(alices.bases)), bobs))
    assert ends.alice.failure is not None
    assert ends.alice.failure.reason is AbortReason.LOCAL
    assert "in each pair of settings" in str(ends.alice.failure)


@pytest.mark.parametrize("dropped", [BellTest.KIND, BellAnswer.KIND])
def test_who_leaves_its_part_of_the_test_out_gets_no_key(dropped: int) -> None:
    ends = make_ends(np.random.default_rng(1), TESTED)
    ends.change = lambda _number, data: [] if unframe(data).kind == dropped else [data]
    ends.run(werner(np.random.default_rng(2), 1.0))
    assert ends.alice.key is ends.bob.key is None


def test_tests_without_a_session_that_has_them_are_refused() -> None:
    _alices, bobs = werner(np.random.default_rng(2), 1.0)
    with pytest.raises(ValueError, match="give both or none"):
        make_ends(np.random.default_rng(1)).bob.add_block(bobs)
