"""How long a tamper seal takes: measured, enumerated, and by Wald's approximations."""

from math import ceil, sqrt

import pytest

from applications.sealing.sequential_test import Question
from evidence.curves import theory
from evidence.curves.catalogue import EXPERIMENTS, measure
from evidence.curves.entangled_keys import sealed_error
from evidence.curves.wald import lengths, pairs_to_alarm, wald_pairs_to_alarm

QUESTION = Question(0.01, 0.25, 1e-6, 0.01)


def test_where_every_pair_goes_the_same_way_a_test_takes_as_many_as_it_must() -> None:
    (agreeing, differing), (low, high) = QUESTION.steps, QUESTION.bounds
    assert lengths(QUESTION, 0.0) == (ceil(low / agreeing), 0.0)
    assert lengths(QUESTION, 1.0) == (ceil(high / differing), 1.0)


def test_a_whole_fibre_is_accused_less_often_than_is_said() -> None:
    _pairs, alarm = lengths(QUESTION, QUESTION.whole)
    assert 0.3 * QUESTION.false_alarm < alarm < QUESTION.false_alarm
    _pairs, alarm = lengths(QUESTION, QUESTION.tapped)
    assert 1 - QUESTION.missed < alarm < 1


@pytest.mark.parametrize("tapped", [0.15, 0.3, 0.7, 1.0])
def test_wald_expects_less_by_what_the_last_step_goes_too_far(tapped: float) -> None:
    """By one step up at most, of those that it takes (about 14 / 2), where alarms are sure."""
    values = EXPERIMENTS["seal"].complete({"tapped": tapped})
    enumerated, wald = (
        expected(QUESTION, sealed_error(values))
        for expected in (pairs_to_alarm, wald_pairs_to_alarm)
    )
    _agreeing, differing = QUESTION.steps
    assert wald < enumerated < wald * (1 + differing / QUESTION.bounds[1])


def test_pairs_differ_as_often_as_noise_and_intruder_say() -> None:
    """A photon measured in the wrong basis is wrong half of the time, whatever the noise."""
    p, tapped = 0.02, 0.4
    values = EXPERIMENTS["seal"].complete({"tapped": tapped, "depolarizing": p})
    wrong_basis = tapped / 2
    assert sealed_error(values) == pytest.approx(
        (1 - wrong_basis) * p / 2 + wrong_basis / 2, abs=1e-12
    )
    assert theory.bit_error(p) == p / 2


def test_alarms_come_when_theory_says() -> None:
    alarms = 60
    values = EXPERIMENTS["seal"].complete({"tapped": 0.5, "alarms": alarms})
    found, deviation = measure("seal", values, 7)["pairs"]
    expected = pairs_to_alarm(QUESTION, sealed_error(values))
    assert abs(found - expected) < 5 * deviation
    assert deviation < expected / sqrt(alarms)
