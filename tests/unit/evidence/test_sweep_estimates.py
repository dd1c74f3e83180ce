"""Standard errors are right: numbers drawn many times spread as much as they say."""

import math

import numpy as np
import pytest

from evidence.curves.estimates import Estimate, information, mean, proportion, ratio
from evidence.curves.theory import capacity

SEED = 5
REPEATS = 400  # the spread of these is known to 3.5 %; the bound is 5 times that


def test_the_error_of_a_proportion_is_its_spread() -> None:
    random = np.random.default_rng(SEED)
    estimates = [proportion(int(k), 1000) for k in random.binomial(1000, 0.1, REPEATS)]
    _assert_spread(estimates)


def test_the_error_of_a_mean_is_its_spread() -> None:
    random = np.random.default_rng(SEED)
    counts = random.multinomial(1000, [0.7, 0.2, 0.1], REPEATS)
    _assert_spread([mean((0, 0.5, 1), row.tolist()) for row in counts])


def test_the_error_of_a_ratio_is_its_spread_also_if_errors_come_in_clumps() -> None:
    random = np.random.default_rng(SEED)
    _assert_spread(
        [ratio(4 * random.binomial(500, 0.02, 60), np.full(60, 2000)) for _ in range(REPEATS)]
    )


def test_the_error_of_a_capacity_is_its_spread() -> None:
    random = np.random.default_rng(SEED)
    likely = [0.925, 0.025, 0.025, 0.025]
    estimates = [information(row.tolist()) for row in random.multinomial(10_000, likely, REPEATS)]
    _assert_spread(estimates)
    assert np.mean([each.value for each in estimates]) == pytest.approx(capacity(0.1), abs=2e-3)


def test_what_was_never_seen_may_still_happen() -> None:
    assert proportion(0, 1000).agrees(0.004)
    assert not proportion(0, 1000).agrees(0.02)
    assert ratio([0, 0], [500, 500], clump=12).agrees(0.03)
    assert not ratio([0, 0], [500, 500], clump=12).agrees(0.07)


def test_five_standard_errors_are_the_limit() -> None:
    assert Estimate(1.0, 0.1).agrees(1.49)
    assert not Estimate(1.0, 0.1).agrees(1.51)
    assert not Estimate(math.nan, math.nan).agrees(1.0)


def test_without_draws_there_is_no_number() -> None:
    for estimate in (proportion(0, 0), mean((0, 1), (0, 0)), ratio([0], [0]), information([0] * 4)):
        assert math.isnan(estimate.value)


def _assert_spread(estimates: list[Estimate]) -> None:
    spread = np.std([each.value for each in estimates])
    text = np.mean([each.error for each in estimates])
    assert text == pytest.approx(spread, rel=0.18)
