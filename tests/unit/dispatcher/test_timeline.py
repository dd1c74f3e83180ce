"""The cross-connects of a switch at the time when light came."""

import numpy as np

from dispatcher.switch.timeline import REMEMBERED_NS, Timeline

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


def test_a_circuit_begins_when_its_path_opens_and_counts_what_passes() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000, {1: 9})
    (circuit,) = timeline.circuits(1000)
    assert (circuit.number, circuit.since_ns, circuit.last_ns, circuit.photons) == (
        9,
        1100,
        1100,
        0,
    )
    circuit.count(np.array([True, True, False]), np.array([1200, 1300, 1400]))
    circuit.count(np.array([True]), np.array([1250]))
    assert (circuit.photons, circuit.last_ns) == (3, 1300)


def test_a_new_circuit_does_not_interrupt_a_path_that_stays() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000, {1: 7})
    assert timeline.connect({1: 2}, 2000, {1: 8}) == (2000, {}, {})
    times_ns = np.array([1999, 2000, 2001])
    parts = [(part, interval.circuit.number) for part, interval in timeline.passages(1, times_ns)]
    assert parts == [(slice(0, 1), 7), (slice(1, 3), 8)]
    assert path(timeline, 1, 1999, 2000, 2001) == [2, 2, 2]


def test_a_path_renamed_before_it_opens_has_the_new_name_alone() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000, {1: 7})
    timeline.connect({1: 2}, 1050, {1: 8})
    ((_part, interval),) = timeline.passages(1, np.array([1100, 1200]))
    assert (interval.circuit.number, interval.circuit.since_ns) == (8, 1100)


def test_a_closed_circuit_is_remembered_for_a_while() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000, {1: 7})
    timeline.connect({}, 2000)
    assert [circuit.number for circuit in timeline.circuits(2000 + REMEMBERED_NS)] == [7]
    assert timeline.circuits(2001 + REMEMBERED_NS) == []
    # Of the same name there can be a new one, which begins at 0.
    timeline.circuits(2000)[0].photons = 5
    timeline.connect({1: 3}, 3000 + REMEMBERED_NS, {1: 7})
    assert [circuit.photons for circuit in timeline.circuits(3000 + REMEMBERED_NS)] == [0]


def test_a_circuit_that_opens_again_soon_goes_on_counting() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000, {1: 7})
    timeline.circuits(1000)[0].photons = 5
    timeline.connect({}, 2000)
    timeline.connect({1: 3}, 3000, {1: 7})
    (circuit,) = timeline.circuits(3000 + 2 * REMEMBERED_NS)
    assert (circuit.photons, circuit.since_ns) == (5, 1100)


def test_a_circuit_that_opens_again_keeps_no_other_from_being_forgotten() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2, 3: 4}, 1000, {1: 7, 3: 8})
    timeline.connect({3: 4}, 2000, {3: 8})
    timeline.connect({1: 2}, 3000, {1: 7})
    timeline.connect({1: 2}, 3001 + REMEMBERED_NS, {1: 7})
    assert list(timeline._circuits) == [7]
    timeline.connect({}, 4000 + REMEMBERED_NS)
    timeline.connect({}, 4001 + 2 * REMEMBERED_NS)
    assert not timeline._circuits


def test_outputs_in_use_are_those_of_open_paths() -> None:
    timeline = Timeline(SWITCHING_NS)
    timeline.connect({1: 2}, 1000)
    timeline.connect({1: 2, 3: 4}, 2000)
    in_use = timeline.outputs_in_use(np.array([1099, 1100, 2099, 2100]))
    assert {port: mask.tolist() for port, mask in in_use.items()} == {
        2: [False, True, True, True],
        4: [False, False, False, True],
    }
