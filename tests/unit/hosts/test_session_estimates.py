"""Estimates that sessions tell of their light: from their summaries, and how often."""

from math import nan, sqrt
from typing import Any

import pytest

from hosts.middleware.device import MOST_UNTOLD, Estimates, estimates_of
from wire.monitor_messages import Interval, Quantity, SessionEstimate

Z = 1.959964  # of a normal distribution 95 % are within this many standard deviations


def wilson(wrong: int, number: int) -> tuple[float, float]:
    """Return Wilson's score interval (J. Am. Stat. Assoc. 22, 209, 1927, equation 4)."""
    share = wrong / number
    middle = (share + Z**2 / (2 * number)) / (1 + Z**2 / number)
    half = Z * sqrt(share * (1 - share) / number + Z**2 / (4 * number**2)) / (1 + Z**2 / number)
    return middle - half, middle + half


@pytest.mark.parametrize(
    ("summary", "counts", "quantity", "interval"),
    [
        (  # of pairs, with the interval that the service gives
            {"fidelity": 0.9, "fidelity_low": 0.8, "fidelity_high": 0.95, "compared": 7},
            {},
            Quantity.FIDELITY,
            (0.9, 0.8, 0.95),
        ),
        (  # of teleported or GHZ states, with its standard error
            {"fidelity": 0.9, "fidelity_error": 0.01},
            {},
            Quantity.FIDELITY,
            (0.9, 0.9 - Z * 0.01, 0.9 + Z * 0.01),
        ),
        (
            {"qber": 0.02, "qber_low": 0.01, "qber_high": 0.04, "chsh": nan},
            {},
            Quantity.QBER,
            (0.02, 0.01, 0.04),
        ),
        ({"chsh": 2.7, "chsh_error": 0.1}, {}, Quantity.CHSH, (2.7, 2.7 - Z * 0.1, 2.7 + Z * 0.1)),
        (  # of a conference key
            {"qber_x": 0.05, "tests_in_x": 200},
            {},
            Quantity.QBER,
            (0.05, *wilson(10, 200)),
        ),
        (  # of a seal
            {"error_rate": 0.01, "compared": 1000},
            {},
            Quantity.ERROR_RATE,
            (0.01, *wilson(10, 1000)),
        ),
        (  # of superdense coding, while it lasts
            {},
            {"pairs_received": 400, "pairs_lost": 3, "symbol_errors": 12},
            Quantity.ERROR_RATE,
            (0.03, *wilson(12, 400)),
        ),
    ],
)
def test_estimates_are_those_of_the_summary(
    summary: dict[str, Any],
    counts: dict[str, int],
    quantity: Quantity,
    interval: tuple[float, float, float],
) -> None:
    found = estimates_of(summary, counts)
    assert found.keys() == {quantity}
    assert found[quantity] == pytest.approx(interval, abs=1e-6)


@pytest.mark.parametrize(
    "summary",
    [
        {},
        {"fidelity": None, "fidelity_low": None, "fidelity_high": None, "compared": 7},
        {"fidelity": None, "fidelity_error": None},
        {"error_rate": None, "compared": 0},
        {"chsh": nan, "chsh_error": nan},
    ],
)
def test_what_is_not_known_is_not_told(summary: dict[str, Any]) -> None:
    assert estimates_of(summary, {"pairs_received": 0, "symbol_errors": 0}) == {}
    assert estimates_of(summary, {"pairs_sent": 10, "symbol_errors": 1}) == {}


def test_no_estimate_is_outside_its_interval() -> None:
    """Where nothing was wrong, rounding would put the lower end above 0."""
    for number in range(1, 2000):
        found = estimates_of({"error_rate": 0.0, "compared": number}, {})[Quantity.ERROR_RATE]
        assert found.low <= found.value <= found.high


def test_an_estimate_is_told_again_when_it_says_something_new() -> None:
    estimates = Estimates()

    def report(value: float, low: float, high: float, over: bool = False) -> list[SessionEstimate]:
        estimates.note(7, {Quantity.QBER: Interval(value, low, high)}, over)
        return estimates.take()

    assert report(0.05, 0.01, 0.09) == [SessionEstimate(0, 7, Quantity.QBER, 0.05, 0.01, 0.09)]
    assert report(0.05, 0.01, 0.09) == []
    assert report(0.06, 0.03, 0.09) == []  # within the reported interval, and hardly sharper
    assert report(0.06, 0.04, 0.08) == [SessionEstimate(0, 7, Quantity.QBER, 0.06, 0.04, 0.08)]
    assert report(0.09, 0.07, 0.11) == [SessionEstimate(0, 7, Quantity.QBER, 0.09, 0.07, 0.11)]
    assert report(0.089, 0.07, 0.11, over=True) == [
        SessionEstimate(0, 7, Quantity.QBER, 0.089, 0.07, 0.11)
    ]
    assert estimates.take() == []


def test_what_nobody_takes_does_not_grow_without_end() -> None:
    estimates = Estimates()
    for session in range(2 * MOST_UNTOLD):
        estimates.note(session, {Quantity.QBER: Interval(0.0, 0.0, 0.1)}, over=True)
    report = estimates.take()
    assert [each.about for each in report] == list(range(MOST_UNTOLD, 2 * MOST_UNTOLD))
