"""Distributed pairs against closed forms, within 5 standard errors; whole stacks, seed 1."""

from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from bell_pairs import Bell, near
from stacks_scene import ask, grant

from wire.config import PathOptics
from wire.metadata.setup import Setup
from wire.outcomes import Pauli
from wire.parameters.physics import Device, Memory, PairSource

COUNT = 2000
SAMPLE = 0.8


def source(*bell: float) -> dict[str, Any]:
    """Return the network whose source emits Bell states with these probabilities, or F."""
    made = PairSource(fidelity=bell[0]) if len(bell) == 1 else PairSource(bell_diagonal=bell)
    return {"devices": {"charlie": Device(source=made)}}


def werner(fidelity: float) -> Bell:
    """Return a Werner pair."""
    return (fidelity, *[(1 - fidelity) / 3] * 3)  # type: ignore[return-value]


def bbpssw(fidelity: float) -> tuple[float, float]:
    """Return fidelity and success of a round (Phys. Rev. Lett. 76, 722, equation 7)."""
    wrong = (1 - fidelity) / 3
    success = fidelity**2 + 2 * fidelity * wrong + 5 * wrong**2
    return (fidelity**2 + wrong**2) / success, success


def dejmps(pair: Bell) -> tuple[Bell, float]:
    """Return pair and success of a round (Phys. Rev. Lett. 77, 2818, equation 3)."""
    phi, psi, phi_minus, psi_minus = pair
    success = (phi + psi_minus) ** 2 + (psi + phi_minus) ** 2
    made = (
        (phi**2 + psi_minus**2) / success,
        (psi**2 + phi_minus**2) / success,
        2 * phi * psi_minus / success,
        2 * psi * phi_minus / success,
    )
    return made, success


def within(found: int, count: int, probability: float) -> bool:
    """Return whether a count is what a probability lets expect."""
    return abs(found - count * probability) <= 5 * sqrt(count * probability * (1 - probability))


def test_ideal_pairs_are_perfect_and_both_ends_say_so(tmp_path: Path) -> None:
    alice, bob = ask(tmp_path, "distribute", count=COUNT)
    assert alice["pairs"] == bob["pairs"] == COUNT
    assert alice["fidelity"] == bob["fidelity"] == alice["fidelity_high"] == 1
    assert 0.95 < alice["fidelity_low"] < 1
    assert alice["session"] == bob["session"]
    assert alice["rounds"] == 0
    assert alice["pairs_per_s"] == pytest.approx(COUNT / alice["elapsed_s"])


def test_depolarised_pairs_have_the_fidelity_of_theory(tmp_path: Path) -> None:
    share = 0.2  # of each photon, X, Y and Z each with probability share / 4
    physics = {"depolarizing": share}
    alice, bob = ask(tmp_path, "distribute", physics=physics, count=COUNT, sample=SAMPLE)
    expected = (1 + 3 * (1 - share) ** 4) / 4  # each half passes two fibres
    assert near(alice, werner(expected))
    assert bob["fidelity"] == alice["fidelity"]
    assert alice["fidelity_low"] < alice["fidelity"] < alice["fidelity_high"]


def test_lost_halves_are_in_no_pair(tmp_path: Path) -> None:
    physics = {"loss_db_per_km": 300.0}
    alice, _bob = ask(tmp_path, "distribute", physics=physics, count=COUNT)
    assert alice["fidelity"] == 1
    assert alice["pairs"] == COUNT
    assert within(alice["shared"], alice["emitted"], 10 ** (-4 * 3 / 10))  # four fibres of 10 m


@pytest.mark.parametrize("rotation", [Pauli.X, Pauli.Z, Pauli.XZ])
def test_the_known_rotation_of_the_paths_is_undone(tmp_path: Path, rotation: Pauli) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), rotation=rotation)

    physics = {"optics": [PathOptics(5, 2, rotation=rotation)]}  # bob's half alone
    alice, _bob = ask(tmp_path, "distribute", judge, physics, count=COUNT)
    assert alice["fidelity"] == 1


def test_a_rotation_that_nobody_knows_of_is_seen(tmp_path: Path) -> None:
    physics = {"optics": [PathOptics(5, 2, rotation=Pauli.X)]}
    alice, _bob = ask(tmp_path, "distribute", physics=physics, count=COUNT)
    assert alice["fidelity"] == 0


@pytest.mark.parametrize("purification", ["bbpssw", "dejmps"])
def test_a_round_has_gain_and_success_of_the_literature(tmp_path: Path, purification: str) -> None:
    assert bbpssw(0.9) == pytest.approx((0.926396, 0.875556), abs=5e-7)
    assert dejmps(werner(0.9))[0][0] == pytest.approx(0.926396, abs=5e-7)
    options: dict[str, Any] = {
        "count": COUNT,
        "sample": SAMPLE,
        "purification": purification,
        "rounds": 1,
    }
    alice, bob = ask(tmp_path, "distribute", physics=source(0.9), **options)
    assert alice["rounds"] == bob["rounds"] == 1
    assert within(alice["survived"], alice["compared"], 0.875556)
    made = werner(0.926396) if purification == "bbpssw" else dejmps(werner(0.9))[0]
    assert near(alice, made)


def test_two_rounds_of_dejmps_gain_more(tmp_path: Path) -> None:
    once, _success = dejmps(werner(0.8))
    twice, _success = dejmps(once)
    options: dict[str, Any] = {"count": COUNT, "sample": SAMPLE, "rounds": 2}
    alice, _bob = ask(tmp_path, "distribute", physics=source(0.8), **options)
    assert twice[0] > bbpssw(once[0])[0] + 0.03
    assert near(alice, twice)


@pytest.mark.nightly
def test_two_rounds_of_bbpssw_are_those_of_werner_pairs(tmp_path: Path) -> None:
    twice, _success = bbpssw(bbpssw(0.8)[0])
    options: dict[str, Any] = {
        "count": COUNT,
        "sample": SAMPLE,
        "rounds": 2,
        "purification": "bbpssw",
    }
    alice, _bob = ask(tmp_path, "distribute", physics=source(0.8), **options)
    assert near(alice, werner(twice))


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("bell", [(0.8, 0.2, 0.0, 0.0), (0.8, 0.0, 0.2, 0.0), (0.8, 0.0, 0.0, 0.2)])
def test_pairs_with_one_kind_of_error_are_twirled_or_used_as_they_are(
    tmp_path: Path, bell: Bell
) -> None:
    options: dict[str, Any] = {"count": COUNT, "sample": SAMPLE, "rounds": 1}
    for purification, made in {
        "bbpssw": (werner(bbpssw(0.8)[0]), bbpssw(0.8)[1]),
        "dejmps": dejmps(bell),
    }.items():
        alice, _bob = ask(
            tmp_path, "distribute", physics=source(*bell), purification=purification, **options
        )
        assert near(alice, made[0])
        assert within(alice["survived"], alice["compared"], made[1])


def test_as_many_rounds_are_made_as_the_fidelity_needs(tmp_path: Path) -> None:
    options: dict[str, Any] = {"count": 500, "fidelity": 0.96, "sample": 0.3}
    alice, bob = ask(tmp_path, "distribute", physics=source(0.8), **options)
    assert alice["fidelity"] >= 0.96
    assert 2 <= alice["rounds"] == bob["rounds"] <= 4
    assert alice["pairs"] == 500


def test_nothing_is_purified_that_is_good_enough(tmp_path: Path) -> None:
    options: dict[str, Any] = {"count": 500, "fidelity": 0.85, "sample": 0.3}
    alice, _bob = ask(tmp_path, "distribute", physics=source(0.95), **options)
    assert (alice["rounds"], alice["compared"]) == (0, 0)


def test_what_a_memory_loses_is_in_no_pair_and_changes_no_other(tmp_path: Path) -> None:
    memory = Memory(efficiency=0.8)
    physics = source(0.9)
    physics["devices"] |= {name: Device(memory=memory) for name in ("alice", "bob")}
    options: dict[str, Any] = {"count": COUNT, "sample": SAMPLE, "rounds": 1}
    alice, _bob = ask(tmp_path, "distribute", physics=physics, **options)
    # Of each two pairs four halves are read out; those measured must all be of them.
    assert within(alice["survived"], alice["compared"], 0.875556 * 0.8**4)
    assert near(alice, dejmps(werner(0.9))[0])
