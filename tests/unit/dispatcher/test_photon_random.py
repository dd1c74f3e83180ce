"""Numbers of a normal distribution of which only the far ones are drawn; 5 sigma, seed 1."""

from math import erfc, sqrt

import numpy as np
import pytest
from five_sigma import within

from dispatcher.photon_random import PhotonRandom, PhotonsByKey
from dispatcher.sabot.draws import Draws

COUNT = 2_000_000
RANDOM = PhotonRandom(Draws(1), (7, 0, 0), "here", COUNT)


def beyond(least: float) -> float:
    return erfc(least / sqrt(2))


@pytest.mark.parametrize("least", [0.0, 0.9, 1.0, 1.5, 2.5, 4.0])
def test_outliers_are_as_common_and_as_far_out_as_normal_numbers(least: float) -> None:
    photons, numbers = RANDOM.outliers(f"beyond {least}", least)
    assert (np.diff(photons) > 0).all()
    assert within(photons.size, COUNT, beyond(least))
    assert within(int((photons < COUNT // 3).sum()), photons.size, 1 / 3)
    assert within(int((numbers > 0).sum()), photons.size, 1 / 2)
    assert (np.abs(numbers) >= least).all()
    for extra_pairs in (0.1, 0.3, 1.0):
        farther = int((np.abs(numbers) > least + extra_pairs).sum())
        assert within(farther, photons.size, beyond(least + extra_pairs) / beyond(least))


def test_nothing_is_so_far_out_that_no_number_reaches_there() -> None:
    photons, numbers = RANDOM.outliers("nowhere", 40.0)
    assert photons.size == numbers.size == 0


def test_extra_pairs_photons_have_random_numbers_of_their_own() -> None:
    few = PhotonRandom(Draws(1), (7, 0, 0), "here", 1000)
    for photons in (few.beside(1000), few.at("there")):
        assert not (photons.uniform("lost") == few.uniform("lost")).any()


def test_keyed_numbers_are_normal_and_the_same_whichever_others_are_drawn() -> None:
    keys = np.arange(COUNT)
    numbers = PhotonsByKey.of(RANDOM, keys).normal("keyed")
    for least in (0.1, 0.5, 1.0, 2.0, 4.0):
        assert within(int((numbers >= least).sum()), COUNT, beyond(least) / 2)
        assert within(int((numbers <= -least).sum()), COUNT, beyond(least) / 2)
    for some in (keys[5:6], keys[1:1000:3], keys[::-7]):
        assert np.array_equal(PhotonsByKey.of(RANDOM, some).normal("keyed"), numbers[some])


def test_two_numbers_of_one_word_tell_nothing_of_each_other() -> None:
    one, other = PhotonsByKey.of(RANDOM, np.arange(COUNT)).halves("two")
    for least in (0.1, 0.5, 0.9):
        assert within(int((one < least).sum()), COUNT, least)
        assert within(int(((one < least) & (other < 0.5)).sum()), COUNT, least / 2)
