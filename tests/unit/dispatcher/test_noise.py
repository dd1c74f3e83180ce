"""Noise models against their closed forms, within 5 sigma; the seed is fixed."""

import numpy as np
import pytest
from numpy.typing import NDArray

from dispatcher.noise import Depolarizing, Effect, Loss

COUNT = 200_000


def uniform(_purpose: str) -> NDArray[np.float64]:
    """Draw for COUNT photons."""
    return np.random.default_rng(1).random(COUNT)


def never(purpose: str) -> NDArray[np.float64]:
    """Stand for draws that must not be made."""
    raise AssertionError(f"drew for {purpose}")


def within(found: int, probability: float) -> bool:
    """Return whether a count is what a probability lets expect, within 5 sigma."""
    sigma = (COUNT * probability * (1 - probability)) ** 0.5
    return bool(abs(found - COUNT * probability) < 5 * sigma)


@pytest.mark.parametrize("loss_db", [0.2, 3.0, 10.0])
def test_loss_follows_the_attenuation(loss_db: float) -> None:
    lost = Loss(loss_db).effect(uniform).lost
    assert lost is not None
    assert within(COUNT - int(lost.sum()), 10 ** (-loss_db / 10))


@pytest.mark.parametrize("p", [0.01, 0.3, 1.0])
def test_depolarizing_does_each_pauli_with_a_quarter_of_p(p: float) -> None:
    paulis = Depolarizing(p).effect(uniform).paulis
    assert paulis is not None
    counts = np.bincount(paulis, minlength=4).tolist()
    assert within(counts[0], 1 - 3 * p / 4)
    assert all(within(count, p / 4) for count in counts[1:])
    assert len(counts) == 4


def test_nothing_is_drawn_where_there_is_no_noise() -> None:
    assert Loss(0).effect(never) == Depolarizing(0).effect(never) == Effect()
