"""Delays of software: what a user writes, and what is drawn."""

import re
from argparse import ArgumentTypeError
from math import sqrt
from random import Random

import pytest

from topologies.system.processes.programs import ROOT
from wire.parameters.delays import PRESETS, delay, draws, is_queued

DRAWS = 20_000


@pytest.mark.parametrize(
    ("text", "mean_ns", "deviation_ns"),
    [
        ("250ns", 250, 0),
        ("1.5us", 1_500, 0),
        ("2s", 2e9, 0),
        ("queued(1ms)", 1e6, 0),
        ("exponential(3ms)", 3e6, 3e6),
        ("uniform(1ms, 4ms)", 2.5e6, 3e6 / sqrt(12)),
    ],
)
def test_draws_have_the_mean_and_deviation_of_the_distribution(
    text: str, mean_ns: float, deviation_ns: float
) -> None:
    drawn = draws(delay(text), Random(1))
    values = [drawn() for _ in range(DRAWS)]
    assert all(isinstance(value, int) and value >= 0 for value in values)
    mean = sum(values) / DRAWS
    assert abs(mean - mean_ns) <= 5 * deviation_ns / sqrt(DRAWS)
    second = sum((value - mean) ** 2 for value in values) / DRAWS
    assert sqrt(second) == pytest.approx(deviation_ns, rel=0.05)


def test_presets_are_those_of_the_page_of_time() -> None:
    page = (ROOT / "docs/time.md").read_text()
    assert dict(re.findall(r"^\| `([a-z-]+)` \| `([^`]+)` \|", page, re.MULTILINE)) == PRESETS
    assert is_queued("ryu")
    assert draws(delay("ryu"), Random(1))() == 350_000


@pytest.mark.parametrize(
    "text",
    [
        *("5", "-5ms", "5 min", "11s", "exponential(1ms,2ms)", "uniform(1ms)", "normal(1ms)"),
        "uniform(3ms,1ms)",
    ],
)
def test_what_is_no_delay_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="write 5ms"):
        delay(text)
