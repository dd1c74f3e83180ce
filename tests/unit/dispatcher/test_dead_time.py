"""Dead time that later light does not extend, against a walk click by click; the seed is 1."""

import numpy as np
import pytest
from numpy.typing import NDArray

from dispatcher.devices.detector import seen, union

Mask = NDArray[np.bool_]


def one_by_one(clicks: Mask, dead_slots: int) -> Mask:
    """Return which clicks are seen, click by click."""
    found, last = np.zeros_like(clicks), -dead_slots
    for slot in np.flatnonzero(clicks).tolist():
        if slot - last >= dead_slots:
            found[slot], last = True, slot
    return found


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("count", [1, 2, 3, 10, 97, 3_000])
@pytest.mark.parametrize("probability", [0.0, 0.01, 0.3, 1.0])
@pytest.mark.parametrize("dead_slots", [0, 1, 2, 3, 50, 2_000])
def test_clicks_are_seen_as_one_after_the_other(
    count: int, probability: float, dead_slots: int
) -> None:
    random = np.random.default_rng(1)
    for _ in range(5):
        clicks = random.random(count) < probability
        found = seen(np.flatnonzero(clicks), dead_slots, count)
        assert np.array_equal(found, np.flatnonzero(one_by_one(clicks, dead_slots)))


@pytest.mark.parametrize(("probability", "dead_slots"), [(0.3, 5), (0.05, 100), (0.9, 2)])
def test_the_rate_is_that_of_a_dead_time_that_is_not_extended(
    probability: float, dead_slots: int
) -> None:
    """For pulses n / (1 + n tau) becomes p / (1 + p (d - 1)); bound: 5 sigma of a renewal."""
    count = 1_000_000
    clicks = np.random.default_rng(1).random(count) < probability
    found = seen(np.flatnonzero(clicks), dead_slots, count).size
    mean = dead_slots - 1 + 1 / probability
    sigma = (count * (1 - probability) / probability**2 / mean**3) ** 0.5
    assert abs(found - count / mean) < 5 * sigma + 1


@pytest.mark.parametrize("sizes", [(0, 0), (0, 9), (9, 0), (1, 200), (200, 1), (80, 90)])
def test_a_union_has_each_slot_of_either_once(sizes: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        one, other = (np.sort(random.choice(300, size, replace=False)) for size in sizes)
        assert np.array_equal(union(one, other), np.union1d(one, other))
