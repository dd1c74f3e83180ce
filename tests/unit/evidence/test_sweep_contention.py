"""The controller's arbiter on a trunk: who is blocked and who waits, as Erlang says; seed 1.

Within five standard errors, between batches of sessions one after the other.
"""

import asyncio

import pytest

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.contention import contend
from evidence.curves.experiment import Outcome
from evidence.curves.parameters import Point
from evidence.traffic.erlang import erlang_b, erlang_c, mean_wait

SESSIONS = 1_600


def measured(**given: float | str) -> tuple[Point, Outcome]:
    values = EXPERIMENTS["light"].complete({"sessions": SESSIONS, **given})
    return values, asyncio.run(contend(values, seed=1))


@pytest.mark.parametrize("holding", ["exponential", "constant"])
def test_a_trunk_of_three_fibres_is_taken_as_often_as_erlang_b_says(holding: str) -> None:
    values, outcome = measured(load=2.0, channels=3, holding=holding)
    wanted = (8 / 6) / (1 + 2 + 2 + 8 / 6)  # 2^3 / 3! over the sum of 2^n / n!
    assert EXPERIMENTS["light"].measure("blocked").theory(values) == pytest.approx(wanted)
    assert outcome["blocked"].agrees(wanted)
    assert not outcome["blocked"].agrees(erlang_b(2.0, 2))
    assert not outcome["blocked"].agrees(erlang_b(2.0, 4))
    assert outcome["waited"].value == 0


def test_wavelengths_of_one_fibre_are_taken_as_often_as_erlang_b_says() -> None:
    values, outcome = measured(load=2.0, channels=3, trunk="wavelengths")
    wanted = (8 / 6) / (1 + 2 + 2 + 8 / 6)
    assert EXPERIMENTS["light"].measure("blocked").theory(values) == pytest.approx(wanted)
    assert outcome["blocked"].agrees(wanted)
    assert not outcome["blocked"].agrees(erlang_b(2.0, 2))
    assert not outcome["blocked"].agrees(erlang_b(2.0, 4))


@pytest.mark.nightly
def test_who_waits_for_wavelengths_waits_as_erlang_c_says() -> None:
    _values, outcome = measured(load=1.2, channels=2, contention="queue", trunk="wavelengths")
    assert outcome["waited"].agrees(0.45)  # 2 rho^2 / (1 + rho) for two servers, rho = .6
    assert outcome["wait"].agrees(0.45 / 0.8)
    assert not outcome["waited"].agrees(erlang_c(1.2, 3))


def test_in_the_queue_they_wait_as_often_and_as_long_as_erlang_c_says() -> None:
    _values, outcome = measured(load=0.6, channels=1, contention="queue")
    assert outcome["waited"].agrees(0.6)  # of one server: its load
    assert outcome["wait"].agrees(0.6 / 0.4)  # M/M/1: rho / (1 - rho) of a mean holding time
    assert not outcome["waited"].agrees(erlang_c(0.6, 2))
    assert not outcome["wait"].agrees(mean_wait(0.6, 2, 1.0))
    assert outcome["blocked"].value == 0


def test_what_a_queue_cannot_carry_is_not_measured() -> None:
    values, outcome = measured(load=2.0, channels=2, contention="queue")
    for measure in EXPERIMENTS["light"].measures:
        assert outcome[measure.name].value != outcome[measure.name].value  # NaN
        assert measure.theory(values) is None
