"""What a switch's cross-connects did to light that came at a time."""

import numpy as np

from dispatcher.timeline import REMEMBERED_NS, Timeline

SWITCHING_NS = 100


def path(timeline: Timeline, in_port: int, *times_ns: int) -> list[int]:
    """Return the outputs that light at these times took."""
    return list(timeline.path(in_port, np.array(times_ns, dtype=np.int64)))


def test_light_passes_once_the_switch_has_switched() -> None:
    timeline = Timeline(SWITCHING_NS)
    ready_ns, opened, closed = timeline.connect({1: 2}, 1000)
    assert (ready_ns, opened, closed) == (1100, {1: 2}, {})
    assert path(timeline, 1, 999, 1000, 1099, 1100, 9999) == [0, 0, 0, 2, 2]
    assert path(timeline, 2, 5000) == [0]


def test_a_block_is_cut_where_its_path_closes() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000)
    _ready_ns, opened, closed = timeline.connect({}, 2000)
    assert (opened, closed) == ({}, {1: 2})
    assert path(timeline, 1, 1999, 2000, 2001) == [2, 0, 0]


def test_a_block_is_divided_where_its_path_changes() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000)
    timeline.connect({1: 3}, 2000)
    assert path(timeline, 1, 1500, 1999, 2000, 2099, 2100, 2500) == [2, 2, 0, 0, 3, 3]


def test_connections_that_stay_are_not_interrupted() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000)
    ready_ns, opened, closed = timeline.connect({1: 2, 3: 4}, 2000)
    assert (ready_ns, opened, closed) == (2100, {3: 4}, {})
    assert path(timeline, 1, 1999, 2000, 2050) == [2, 2, 2]


def test_connecting_again_is_ready_when_the_first_is() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000)
    assert timeline.connect({1: 2}, 1050)[0] == 1100
    assert timeline.connect({1: 2}, 5000)[0] == 5000


def test_a_path_replaced_before_it_opened_never_was() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000)
    timeline.connect({1: 3}, 1050)
    assert path(timeline, 1, 1099, 1100, 1149, 1150) == [0, 0, 0, 3]


def test_intervals_closed_long_ago_are_forgotten() -> None:
    timeline = Timeline(SWITCHING_NS)
    for number in range(1000):
        now_ns = number * REMEMBERED_NS // 10
        timeline.connect({1: 2 + number % 2, 5: 6} if number < 3 else {1: 2 + number % 2}, now_ns)
    assert len(timeline._intervals[1]) <= 12
    assert 5 not in timeline._intervals
    assert path(timeline, 1, now_ns - 1, now_ns + SWITCHING_NS) == [2, 3]
