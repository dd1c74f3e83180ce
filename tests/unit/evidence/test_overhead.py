"""Rates of runs compared, and that no kind of run always has the same place."""

import numpy as np
import stim

from evidence.bench.batch_sampler import CIRCUIT
from evidence.bench.overhead import (
    EVERYTHING,
    KINDS,
    NOTHING,
    Measured,
    beside_sampler,
    compared,
    order,
)


def test_a_share_is_of_the_bare_run_in_the_same_round() -> None:
    bare, kept = [1_000_000.0, 500_000.0, 2_000_000.0], [900_000.0, 350_000.0, 1_600_000.0]
    rounds = [
        {kind: Measured(rate if kind == NOTHING else other) for kind in KINDS}
        for rate, other in zip(bare, kept, strict=True)
    ]
    rounds[1][EVERYTHING] = Measured(350_000.0, packets_missed=2)
    reports = dict(compared(rounds))
    assert reports[f"qmn run sdc, {NOTHING}"] == "1,000,000 Bell pairs/s, 100% (100% to 100%)"
    assert reports[f"qmn run sdc, {EVERYTHING}"] == "900,000 Bell pairs/s, 80% (70% to 90%)"
    assert reports["  packets not captured"] == "2"
    assert len(reports) == len(KINDS) + 1


def test_every_second_round_goes_backwards() -> None:
    assert order(0) == order(2) == list(KINDS)
    assert order(1) == list(reversed(KINDS))


def test_a_network_is_compared_with_the_sampler_of_its_own_round() -> None:
    rounds = [{EVERYTHING: Measured(rate)} for rate in (3e6, 8e6, 9e6)]
    reports = dict(beside_sampler("sampler", rounds, [2e6, 4e6, 9e6]))
    assert reports["sampler"] == "4,000,000 Bell pairs/s"
    assert reports[f"  times that, {EVERYTHING}"] == "1.50 (1.00 to 2.00)"


def test_the_sampler_makes_all_four_states_alike_often() -> None:
    """Each outcome of n shots: n/4, give or take 5 standard deviations."""
    shots = 40_000
    bits = stim.Circuit(CIRCUIT).compile_sampler(seed=2).sample(shots)
    counts = np.bincount(bits @ [1, 2], minlength=4)
    assert abs(counts - shots / 4).max() < 5 * (shots * 3 / 16) ** 0.5
