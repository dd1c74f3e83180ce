"""Draws depend on what they are for, not on when or with how many others they are made."""

import numpy as np
import pytest

from dispatcher.sabot.draws import Draws, random_bytes

KEY = (7, 3, 1)


def test_the_same_photon_draws_the_same_in_blocks_of_any_size() -> None:
    draws = Draws(1)
    few, many = draws.uniform(KEY, "loss", 4), draws.uniform(KEY, "loss", 1000)
    assert (few == many[:4]).all()
    assert (draws.bits(KEY, "measure", 13) == draws.bits(KEY, "measure", 999)[:13]).all()


def test_the_order_of_asking_does_not_matter() -> None:
    one, other = Draws(1), Draws(1)
    first = one.bits(KEY, "measure", 64), one.uniform(KEY, "loss", 64)
    second = other.uniform(KEY, "loss", 64), other.bits(KEY, "measure", 64)
    assert (first[0] == second[1]).all()
    assert (first[1] == second[0]).all()


@pytest.mark.parametrize(
    ("seed", "key", "purpose"),
    [
        (2, KEY, "loss"),
        (1, (8, 3, 1), "loss"),
        (1, (7, 4, 1), "loss"),
        (1, (7, 3, 0), "loss"),
        (1, KEY, "noise"),
    ],
)
def test_every_part_of_the_key_counts(seed: int, key: tuple[int, int, int], purpose: str) -> None:
    reference = Draws(1).uniform(KEY, "loss", 8)
    assert not np.isin(Draws(seed).uniform(key, purpose, 8), reference).any()


def test_bits_are_fair() -> None:
    ones = int(Draws(1).bits(KEY, "measure", 100_000).sum())
    assert abs(ones - 50_000) < 5 * 25_000**0.5


def test_a_photon_s_draws_do_not_depend_on_how_its_block_is_divided() -> None:
    whole = Draws(1).photons(KEY, "measure", 100)
    odd = np.arange(1, 100, 2, dtype=np.uint32)
    assert (whole.at(odd).bits() == Draws(1).bits(KEY, "measure", 100)[odd]).all()
    assert (whole.at(odd).uniform() == whole.uniform()[odd]).all()


def test_bits_are_the_first_digits_of_numbers_that_are_uniform() -> None:
    draws, count = Draws(1).photons(KEY, "measure", 100_000), 100_000
    numbers = draws.uniform()
    assert (draws.bits() == (numbers >= 0.5)).all()
    for quantile in (0.1, 0.25, 0.5, 0.9):
        below = int((numbers < quantile).sum())
        assert abs(below - quantile * count) < 5 * (quantile * (1 - quantile) * count) ** 0.5


@pytest.mark.parametrize("count", [1, 3, 4, 5, 8, 13, 16, 1001])
def test_bytes_are_those_of_numpy_and_so_is_what_follows(count: int) -> None:
    one, other = (Draws(1).generator(KEY, "loss") for _ in range(2))
    assert random_bytes(one, count).tobytes() == other.bytes(count)
    assert np.array_equal(one.random(4), other.random(4))
