"""Attacks by bright light, against what the papers' conditions and Poisson's law give."""

import asyncio
from dataclasses import replace
from math import exp, sqrt

import numpy as np
import pytest

from evidence.attacks.bright_light import (
    GUARDED,
    MONITORED,
    AvalanchePhotodiode,
    Glare,
    ReflectingSource,
    blinded,
    shares,
    trojan,
)
from evidence.attacks.laboratory import ATTACKS, LightAttack
from evidence.attacks.photons import Spied

PHOTONS = 40_000
SPLIT = Glare(trigger_w=2e-3)  # half of it is enough for a click
DIODE = AvalanchePhotodiode()


def close(count: int, of: int, share: float) -> bool:
    """Whether a count is within five standard errors of its share."""
    return abs(count - of * share) <= 5 * sqrt(of * share * (1 - share))


def sift(glare: Glare, detector: AvalanchePhotodiode = DIODE) -> Spied:
    return asyncio.run(blinded(PHOTONS, glare, detector))


def test_light_is_divided_as_the_squares_of_cosines() -> None:
    # Z and X are 45 degrees apart, the two states of either 90 (Malus).
    angles = np.radians([0, 90, 45, -45])
    for state, angle in enumerate(angles):
        for basis in (0, 1):
            arms = angles[2 * basis : 2 * basis + 2]
            got = shares(np.array([state], np.uint8), np.array([basis], np.uint8))
            assert got[0] == pytest.approx(np.cos(angle - arms) ** 2, abs=1e-12)


def test_eve_knows_every_bit_and_makes_no_error() -> None:
    """Where half a pulse is below every threshold: max always < 2 min never (Lydersen et al.)."""
    assert DIODE.always_w < 2 * DIODE.never_w
    spied = sift(Glare())
    assert (spied.known, spied.wrong) == (spied.bits, 0)
    # Her basis is alice's, and bob's is, each half the time.
    assert close(spied.bits, PHOTONS, 1 / 4)


def test_pulses_that_are_too_strong_click_twice_where_her_basis_was_wrong() -> None:
    spied = sift(SPLIT)
    assert close(spied.bits, PHOTONS, 1 / 2)
    assert close(spied.wrong, spied.bits, 1 / 4)  # as of intercept and resend


def test_pulses_that_are_too_weak_make_no_click() -> None:
    assert sift(Glare(trigger_w=DIODE.never_w)).bits == 0


def test_between_both_thresholds_a_pulse_clicks_in_proportion() -> None:
    middle = (DIODE.never_w + DIODE.always_w) / 2
    assert close(sift(Glare(trigger_w=middle)).bits, PHOTONS, 1 / 8)


def test_detectors_that_are_not_blind_find_her_by_errors() -> None:
    """Below the power that blinds, both detectors click for a pulse that is divided."""
    spied = sift(Glare(continuous_w=DIODE.blinding_w * 0.99))
    assert close(spied.bits, PHOTONS, 1 / 2)
    assert close(spied.wrong, spied.bits, 1 / 4)


def test_no_light_blinds_a_detector_without_its_monitor_telling() -> None:
    assert MONITORED.tells(MONITORED.blinding_w)
    assert not MONITORED.tells(0.0)
    assert not AvalanchePhotodiode().tells(1.0)


@pytest.mark.parametrize("mean", [0.1, 1.0, 3.0])
def test_a_trojan_horse_tells_as_often_as_a_photon_comes_back(mean: float) -> None:
    source = ReflectingSource(reflection_db=40.0)
    known, bits = trojan(source, mean * 1e4, PHOTONS, amplified=False)
    assert close(known, bits, 1 - exp(-mean))


def test_an_isolator_weakens_it_by_its_decibels() -> None:
    assert ReflectingSource(60.0, 0.0).reflected(1e7) == pytest.approx(10.0)
    assert ReflectingSource(60.0, 30.0).reflected(1e7) == pytest.approx(0.01)


def test_what_comes_back_below_the_alarm_is_amplified_away() -> None:
    source = replace(GUARDED, isolator_db=20.0)  # 1 photon a pulse comes back, of the most
    assert trojan(source, source.alarm_photons * 0.99, PHOTONS, amplified=False)[0] > 0.6 * PHOTONS
    assert trojan(source, source.alarm_photons * 0.99, PHOTONS, amplified=True)[0] == 0
    assert trojan(source, source.alarm_photons, PHOTONS, amplified=True)[0] == 0  # it tells


@pytest.mark.parametrize(("name", "known"), [("blinding", 1.0), ("trojan-light", 1 - exp(-10))])
def test_each_is_in_the_laboratory_with_its_defence(name: str, known: float) -> None:
    attack = ATTACKS[name]
    assert isinstance(attack, LightAttack)
    reached, bits = attack.trial(False, 10_000)
    assert abs(reached - known * bits) <= 5 * sqrt(bits * known * (1 - known))
    assert attack.trial(True, 10_000)[0] == 0
