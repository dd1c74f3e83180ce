"""Packets in the order of time, in memory that does not grow with their number."""

import tempfile
import tracemalloc
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from random import Random

import pytest

from qmn.jobs.superdense import captured_mb
from qmn.results.time_order import Place, in_time_order


def places(count: int, seed: int = 3) -> Iterator[Place]:
    """Yield places of four files, each nearly in time order, as captures are."""
    random = Random(seed)
    for number in range(count):
        time_ns = 10**18 + 1000 * number + random.randrange(5000)
        yield Place(time_ns, time_ns, number % 4, number % 4, random.randrange(1 << 40), 60, 1500)


@pytest.mark.parametrize("at_once", [1, 7, 1000, 5000])
def test_they_are_as_sorted_however_few_are_sorted_at_once(at_once: int) -> None:
    with tempfile.TemporaryFile() as file:
        found = list(in_time_order(places(1000), file, at_once))
    assert found == sorted(places(1000))


def test_no_packets_are_no_packets() -> None:
    with tempfile.TemporaryFile() as file:
        assert list(in_time_order([], file)) == []


def peak_bytes(count: int) -> int:
    tracemalloc.start()
    with tempfile.TemporaryFile() as file:
        for _place in in_time_order(places(count), file, at_once=2000):
            pass
    _now, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


@pytest.mark.nightly
def test_ten_times_the_packets_do_not_take_ten_times_the_memory() -> None:
    """A list of them would: each is more than 64 bytes. In this process others take memory, too."""
    with ProcessPoolExecutor(1, get_context("spawn")) as alone:
        many, few = alone.map(peak_bytes, (100_000, 10_000))
    assert many < 1.5 * few < 1_000_000


def test_the_estimate_of_a_run_counts_the_timeline_of_all() -> None:
    """As a run of 33,554,432 pairs left them: 39.63 MB of captures and 6.71 MB of timeline."""
    assert captured_mb("framed", 33_554_432) == pytest.approx(39.63 + 6.71, rel=0.02)
    short = 1_000_000  # pairs, whose packets are whole in the timeline
    assert captured_mb("framed", short) == pytest.approx(1.18 * 2.02, rel=0.02)
    large = 800_000_000  # pairs, whose captures are too many to be merged by themselves
    assert captured_mb("framed", large) == pytest.approx(39.63 * 800 / 33.554432, rel=0.02)
