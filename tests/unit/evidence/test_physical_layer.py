"""The physical layer as `make bench` measures it is superdense coding indeed."""

import asyncio

import numpy as np
import pytest

from evidence.bench.physical_layer import BLOCK_PAIRS, CASES, Case, Scene, speed

NO_COINCIDENCE = 255
# Six fibres of .2 dB that depolarise by .01, and a dibit is wrong for each Pauli but I, 3p/4
# (Bennett and Wiesner 1992): 3/4 (1 - .99^6), 10^(-.12).
WRONG, TRANSMISSION = 0.0438898879, 0.7585775750
IDEAL, LOSSY, *NOISY = CASES


async def wrong_and_lost(case: Case) -> tuple[float, float]:
    """Return which part of the dibits that came was wrong, and which part was lost."""
    scene = Scene(case)
    await scene.begin()
    seen = await scene.block()
    came = seen != NO_COINCIDENCE
    return float((seen != scene.dibits)[came].mean()), 1 - float(came.mean())


def test_ideal_light_brings_every_dibit() -> None:
    assert asyncio.run(wrong_and_lost(IDEAL)) == (0, 0)


def test_lossy_light_has_the_errors_of_all_fibres_that_it_passes() -> None:
    wrong, lost = asyncio.run(wrong_and_lost(LOSSY))
    assert wrong == pytest.approx(WRONG, abs=5 * np.sqrt(WRONG / BLOCK_PAIRS / TRANSMISSION))
    assert 1 - lost == pytest.approx(TRANSMISSION, abs=5 * np.sqrt(1 / BLOCK_PAIRS))


@pytest.mark.parametrize("case", NOISY, ids=lambda case: case.name.strip())
def test_noisy_light_still_tells_more_than_chance(case: Case) -> None:
    wrong, lost = asyncio.run(wrong_and_lost(case))
    assert 0.05 < wrong < 0.6
    assert 0.3 < lost < 0.999


def test_the_speed_is_that_of_whole_blocks() -> None:
    assert asyncio.run(speed(IDEAL, blocks=2)) > 100_000
