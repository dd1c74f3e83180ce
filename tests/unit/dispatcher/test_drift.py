"""Angles are summed and twirled once, against closed forms within 5 sigma; the seed is 1."""

import numpy as np
import pytest
from numpy.typing import NDArray

from dispatcher.approximations import PHASE
from dispatcher.layer import drift
from dispatcher.layer.ownership import Block, BlockName, Pulses
from dispatcher.sabot.draws import Draws, PhotonDraws
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.tableau import Tableau

COUNT = 200_000
DRAWS = Draws(1)
X = np.ones(COUNT, dtype=np.uint8)
NONE = np.zeros(COUNT, dtype=np.uint8)
BITS = PhotonDraws.given(NONE)


def within(found: int, probability: float) -> bool:
    """Return whether a count is what a probability lets expect, within 5 sigma."""
    sigma = (COUNT * probability * (1 - probability)) ** 0.5
    return bool(abs(found - COUNT * probability) <= 5 * sigma)


def angles(angle_rad: float) -> Pulses:
    return Pulses(angles_rad=np.full(COUNT, angle_rad))


def pairs(sabot: Sabot, one: Pulses, other: Pulses) -> tuple[Block, Block]:
    first, second = (
        Block(BlockName(7, 0, half), register, "bob", pulses=pulses)
        for half, (register, pulses) in enumerate(
            zip(sabot.bell_pairs(COUNT), (one, other), strict=True)
        )
    )
    return first, second


def measured(one: Pulses, other: Pulses, paulis: NDArray[np.uint8] = NONE) -> list[int]:
    """Count Phi+, Psi+, Phi-, Psi- of pairs whose first photon then meets Paulis."""
    sabot = Sabot(Tableau)
    first, second = pairs(sabot, one, other)
    drift.reflect(first.pulses, paulis)
    sabot.pauli(first.register, paulis)
    outcomes = sabot.bell_measure(first.register, second.register, (BITS, BITS))
    drift.twirl_pairs(first, second, outcomes, DRAWS)
    assert first.pulses == second.pulses
    assert not first.pulses.exact
    return [int(np.count_nonzero(outcomes == state)) for state in range(4)]


def test_two_drifts_of_a_fifth_flip_with_sin_squared_of_a_fifth() -> None:
    sabot = Sabot(Tableau)
    first, second = pairs(sabot, angles(0.2 + 0.2), Pulses())
    drift.twirl(first, sabot, DRAWS)
    # |sin .4| / 2: Y of |+>, which the rotation turns to sin .4, and flips of the phase to 0.
    assert first.pulses.approximations.sizes == {PHASE: pytest.approx(np.sin(0.4) / 2)}
    outcomes = sabot.bell_measure(first.register, second.register, (BITS, BITS))
    flipped = int(np.count_nonzero(outcomes == 2))
    assert within(flipped, 0.039470)
    assert not within(flipped, 2 * np.sin(0.1) ** 2 * np.cos(0.1) ** 2)


@pytest.mark.parametrize(
    ("one", "other", "total"), [(0.2, 0.2, 0.4), (0.3, -0.3, 0.0), (1.0, 0.5, 1.5)]
)
def test_the_angles_of_both_photons_of_a_pair_add_up(
    one: float, other: float, total: float
) -> None:
    counts = measured(angles(one), angles(other))
    assert counts[1] == counts[3] == 0
    assert within(counts[2], float(np.sin(total / 2) ** 2))


def test_a_flip_on_the_way_turns_the_angle_of_before_around() -> None:
    counts = measured(angles(0.4), angles(0.4), X)
    assert counts[0] == counts[2] == 0
    assert within(counts[3], float(np.sin(0.4) ** 2))


def test_without_angles_nothing_is_drawn_and_nothing_changes() -> None:
    sabot = Sabot(Tableau)
    first, second = pairs(sabot, Pulses(), Pulses())
    outcomes = sabot.bell_measure(first.register, second.register, (BITS, BITS))
    drift.twirl(first, sabot, None)  # type: ignore[arg-type]
    drift.twirl_pairs(first, second, outcomes, None)  # type: ignore[arg-type]
    assert first.pulses == second.pulses == Pulses()
    assert not outcomes.any()


def test_pairs_that_lack_a_photon_stay_without_outcome() -> None:
    sabot = Sabot(Tableau)
    first, second = pairs(sabot, angles(np.pi), Pulses())
    outcomes = np.full(COUNT, 255, dtype=np.uint8)
    drift.twirl_pairs(first, second, outcomes, DRAWS)
    assert (outcomes == 255).all()
