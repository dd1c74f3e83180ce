"""A tamper seal over whole stacks, and its sequential tests against what theory says of them."""

import asyncio
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from stacks_scene import ask, grant, network, refusal, requested

from applications.key_distribution import light
from applications.sealing.sequential_test import Question, SequentialTest
from hosts import network_loop
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.service_socket import ServiceSocket
from wire.metadata.setup import Setup

PAIRS, BY_EVE = [(4, 1), (5, 2)], [(4, 1), (5, 6), (7, 2)]
QUICK: dict[str, Any] = {"block_pairs": 2000, "rate_hz": 1_000_000}


def alarms(question: Question, error: float, tests: int, seed: int) -> tuple[float, float]:
    """Return how many of a number of tests end in an alarm, and the mean of pairs in a test."""
    draws = np.random.default_rng(seed)
    ended = found = pairs = 0
    while ended < tests:
        test = SequentialTest(question)
        while not test.alarm and ended + test.whole < tests:
            test.add(draws.random(200) < error)
        ended, found, pairs = (
            ended + test.whole + test.alarm,
            found + test.alarm,
            pairs + test.compared,
        )
    return found / ended, pairs / ended


def test_a_whole_fibre_is_accused_as_rarely_as_is_said() -> None:
    """Ville: at most `false_alarm`; Wald: about (1 - B) / (A - B) of the tests, a little less."""
    question, tests = Question(0.02, 0.5, 0.05, 0.02), 4000
    found, _pairs = alarms(question, question.whole, tests, seed=1)
    sigma = sqrt(0.05 * 0.95 / tests)
    assert found < 0.05 + 5 * sigma
    assert found > 0.02  # alarms are not rarer by far, or an intruder is found too late


def test_an_intruder_is_missed_as_rarely_as_is_said() -> None:
    question, tests = Question(0.02, 0.5, 0.02, 0.05), 4000
    found, _pairs = alarms(question, question.tapped, tests, seed=2)
    assert 1 - found < 0.05 + 5 * sqrt(0.05 * 0.95 / tests)
    assert found < 1


def test_a_test_takes_as_many_pairs_as_wald_expects() -> None:
    """(1945): E(n) = (L low + (1 - L) high) / E(step), and up to one step more at either bound."""
    question = Question(0.02, 0.5, 0.001, 0.01)
    found, pairs = alarms(question, question.tapped, 2000, seed=3)
    (agreeing, differing), (low, high) = question.steps, question.bounds
    drift = question.tapped * differing + (1 - question.tapped) * agreeing
    least = (found * high + (1 - found) * low) / drift
    most = (found * (high + differing) + (1 - found) * (low + agreeing)) / drift
    assert least * 0.97 < pairs < most * 1.03


def test_what_comes_after_an_alarm_is_not_looked_at() -> None:
    question = Question(0.01, 1.0, 1e-6, 0.01)
    test = SequentialTest(question)
    test.add(np.ones(100, dtype=bool))
    _agreeing, differing = question.steps
    assert test.alarm
    assert test.compared == int(question.bounds[1] // differing) + 1
    before = test.compared
    test.add(np.zeros(100, dtype=bool))
    assert test.compared == before


def test_pairs_in_parts_are_as_those_at_once() -> None:
    differ = np.random.default_rng(5).random(5000) < 0.03
    whole, parts = (SequentialTest(Question(0.02, 0.3, 1e-9, 0.05)) for _ in range(2))
    whole.add(differ)
    for part in np.array_split(differ, 37):
        parts.add(part)
    assert (whole.compared, whole.whole, whole.alarm) == (parts.compared, parts.whole, parts.alarm)
    assert whole.whole > 0
    assert abs(whole.score - parts.score) < 1e-9


def test_a_whole_fibre_keeps_its_seal(tmp_path: Path) -> None:
    """Noise of p on each of four fibres: (1 - (1 - p)^4) / 2 of the pairs differ."""
    p = 0.002
    fiber = {"paths": PAIRS, "depolarizing": p}
    alice, bob = ask(tmp_path, "seal", physics=fiber, count=20_000, **QUICK)
    error = (1 - (1 - p) ** 4) / 2
    assert alice["alarm"] is False
    assert alice["compared"] >= 20_000
    assert abs(alice["error_rate"] - error) < 5 * sqrt(error / alice["compared"])
    for basis in "zx":
        sigma = 2 * sqrt(error / (alice["compared"] / 2))
        assert abs(alice[f"visibility_{basis}"] - (1 - 2 * error)) < 5 * sigma
    assert alice["tests_whole"] > 100
    assert alice["elapsed_s"] >= alice["light_s"]  # that its pairs take at least, at their rate
    assert alice["pairs_per_s"] == pytest.approx(alice["compared"] / alice["elapsed_s"])
    assert bob["photons"] == alice["emitted"]


def test_the_largest_block_there_may_be_is_compared(tmp_path: Path) -> None:
    light: dict[str, Any] = {"block_pairs": MAX_BLOCK_PAIRS, "rate_hz": 100_000_000}
    count = MAX_BLOCK_PAIRS // 4
    alice, bob = ask(tmp_path, "seal", physics={"paths": PAIRS}, count=count, **light)
    assert (alice["alarm"], alice["emitted"]) == (False, MAX_BLOCK_PAIRS)
    assert (bob["blocks"], bob["photons"]) == (1, MAX_BLOCK_PAIRS)


@pytest.mark.parametrize("rotation", [0, 1, 2, 3])
def test_a_host_can_watch_the_way_to_another_by_pairs_of_its_own(
    tmp_path: Path, rotation: int
) -> None:
    """Half 1 alone travels, over two fibres: (1 - (1 - p)^2) / 2 differ, but for a known Pauli."""
    p = 0.003

    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), rotation=rotation)

    fiber = {"paths": [(1, 2)], "rotation": rotation, "depolarizing": p}
    words = {"count": 10_000, "source": "alice", **QUICK}
    alice, _bob = ask(tmp_path, "seal", judge, fiber, **words)
    error = (1 - (1 - p) ** 2) / 2
    assert alice["alarm"] is False
    assert abs(alice["error_rate"] - error) < 5 * sqrt(error / alice["compared"])


def test_who_measures_on_the_way_breaks_the_seal(tmp_path: Path) -> None:
    """All photons: one in four differs; the alarm takes 33 pairs on average, not 1000."""

    def asked() -> Any:
        with ServiceSocket(tmp_path / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            blocks = eve.intercept(1.0)
            report = requested(tmp_path, "seal", count=100_000, **QUICK)
            eve.shutdown()
            assert list(blocks) == []
        return report

    async def run() -> Any:
        async with network(tmp_path, paths=BY_EVE):
            return await asyncio.to_thread(asked)

    alice, _bob = network_loop.run(run())
    assert alice["alarm"] is True
    assert alice["compared"] < 1000
    assert alice["emitted"] == QUICK["block_pairs"]  # of the first block, and no more light
    assert alice["score"] >= alice["score_of_alarm"]


def test_a_dark_fibre_is_no_seal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(light, "KEY_GRACE_S", 0.05)
    with pytest.raises(Exception, match="see that fibres are whole"):
        ask(tmp_path, "seal", physics={"paths": []}, count=1000, **QUICK)


@pytest.mark.parametrize(
    ("name", "value"), [("whole_error", 0.5), ("false_alarm", 0), ("missed", "x"), ("fraction", 2)]
)
def test_what_cannot_be_asked_is_refused(tmp_path: Path, name: str, value: Any) -> None:
    assert f"{name} {value!r}: choose" in refusal(tmp_path, "seal", **{name: value})
