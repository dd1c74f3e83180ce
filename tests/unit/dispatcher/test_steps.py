"""A setting over time: light meets the value of its moment."""

import numpy as np

from dispatcher.switch.timeline import REMEMBERED_NS, Steps


def at(steps: Steps, *times_ns: int) -> float | list[float]:
    """Return what light at these times met."""
    found = steps.at(np.array(times_ns, dtype=np.int64))
    return found if isinstance(found, float | int) else list(found)


def test_one_number_stands_for_times_without_a_change() -> None:
    steps = Steps(3.0)
    assert at(steps, 1, 2, 3) == 3.0
    steps.set(5.0, 10)
    assert (at(steps, 1, 9), at(steps, 10, 11)) == (3.0, 5.0)


def test_a_change_counts_from_its_moment_on() -> None:
    steps = Steps(3.0)
    steps.set(5.0, 10)
    steps.set(4.0, 20)
    assert at(steps, 9, 10, 19, 20) == [3.0, 5.0, 5.0, 4.0]
    assert steps.now == 4.0


def test_changes_long_ago_are_forgotten_but_not_the_value_they_left() -> None:
    steps = Steps(0.0)
    for number in range(1, 1001):
        steps.set(float(number), number * REMEMBERED_NS // 10)
    assert len(steps._values) <= 12
    now_ns = 100 * REMEMBERED_NS
    assert at(steps, now_ns - REMEMBERED_NS + 1, now_ns) == [990.0, 1000.0]
