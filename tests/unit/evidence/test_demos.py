"""Demos: sums of what networks tell them, by hand and by closed forms, and their grids."""

import subprocess
import sys
from math import exp, isclose, log
from typing import Any

import pytest

from evidence.curves import grid
from evidence.curves.estimates import mean_of_series
from evidence.networks import congestion, control, flapping, head_of_line
from evidence.networks.catalogue import DEMOS, EMULATED, MEASURED_BY
from wire.dispatcher_pb2 import Event
from wire.parameters.fiber import Fiber, FiberEnd


@pytest.mark.parametrize("name", DEMOS)
def test_every_demo_is_a_sweep_on_a_grid_that_can_be(name: str) -> None:
    shown = DEMOS[name]
    assert EMULATED[shown.experiment.name] is shown.experiment
    assert MEASURED_BY[shown.experiment.name] is shown.measure
    assert grid.build(shown.experiment, dict(shown.axes)).size > 3


def test_demos_are_listed_without_root() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "qmn", "lab", "demo"], capture_output=True, text=True, check=True
    )
    assert [line.split()[0] for line in done.stdout.splitlines()] == [*DEMOS]


def test_the_error_of_a_series_is_that_of_its_batches() -> None:
    """Twenty batches of 0 and 1, alternating in runs of five: batch means are those runs'."""
    found = mean_of_series(([0.0] * 5 + [1.0] * 5) * 10)
    assert found.value == 0.5
    assert isclose(found.error, (0.25 * 20 / 19 / 20) ** 0.5)


def test_waits_of_blocks_follow_from_means_over_all_so_far() -> None:
    reports = [{"arrived": 100, "waited_ms": 10.0}, {"arrived": 300, "waited_ms": 30.0}]
    assert congestion.waits_of(reports) == pytest.approx([0.01, (300 * 30 - 100 * 10) / 200 / 1e3])


def test_one_wait_dephases_as_several_do_on_average() -> None:
    """One half has kept all, one half of it: three quarters together."""
    assert isclose(congestion.as_dephasing_averages([0.0, 2.0 * log(2)], 2.0), -2.0 * log(0.75))


def test_datagrams_queue_as_in_a_queue_of_constant_service() -> None:
    """At a load of a half the mean wait of M/D/1 is half a service, at .8 two of them."""
    values = congestion.CONGESTION.complete({"copper_mbps": 1.0, "frame_bytes": 1250})
    for share, services in ((0.5, 0.5), (0.8, 2.0)):
        assert isclose(congestion.queued({**values, "share": share}) or 0, services * 0.01)


def test_teleportation_behind_datagrams_keeps_what_dephasing_leaves() -> None:
    """A third of the cardinal states is along Z, and keeps all; of no coherence 2/3 are found."""
    values = congestion.CONGESTION.complete({"memory_t2_s": 0.2})
    for waited_s, fidelity in ((0.0, 1.0), (0.2, 2 / 3 + exp(-1) / 3), (99.0, 2 / 3)):
        found = congestion.teleported({**values, "measured_wait_s": waited_s})
        assert isclose(found or 0, fidelity)


LOG = """
T alice wait session=ab block=1/0 photons=300 after 0.100000000 to 0.300000000 s Z=15
T alice recall session=ab block=9/0 photons=100 after 0.010000000 s Z=2
T bob wait session=ab block=1/1 photons=300 after 0.400000000 s
T alice measure session=ab block=9/0 photons=100 X=100: 0=52 1=48
T bob recall session=ab block=9/1 photons=100 after 0.020000000 s
T alice wait session=ab block=1/0 photons=300 lost=100 after 0.030000000 s Z=19
T alice recall session=ab block=9/0 photons=100 after 0.001000000 s
T bob recall session=ab block=9/1 photons=100 after 0.050000000 s
T alice wait session=cd block=1/0 photons=300 after 7.0 s
"""


def test_what_is_recalled_has_waited_with_the_others_and_then_alone() -> None:
    (halves,) = control.waits_of(LOG.splitlines()).values()
    assert halves == [pytest.approx([0.21, 0.231]), pytest.approx([0.42, 0.45])]
    kept = control.kept_of(halves, 2.0)
    assert isclose(kept, (exp(-0.63 / 2) + exp(-0.681 / 2)) / 2)


def test_pairs_that_wait_end_at_one_half() -> None:
    """Of Phi+ without coherence the half is Phi+, the other Phi-."""
    values = control.CONTROL.complete({"memory_t2_s": 2.0})
    for waited_s, fidelity in ((0.0, 1.0), (2.0 * log(2), 0.75), (999.0, 0.5)):
        assert isclose(control.expected({**values, "measured_wait_s": waited_s}), fidelity)


def fiber(a: tuple[str, str], b: tuple[str, str]) -> Fiber:
    return Fiber(FiberEnd(*a), FiberEnd(*b))


def event(ms: float, node: str, kind: str, **report: Any) -> Event:
    return Event(time_ns=round(ms * 1e6), node=node, kind=kind, **report)


def test_light_is_in_the_dark_while_no_way_stands_from_end_to_end() -> None:
    """100 ms of light; the way by q1 alone stands until 30 ms, that by q2 as well from 70 on."""
    fibers = [
        fiber(("alice", "alice-q0"), ("q1", "1")),
        fiber(("q1", "2"), ("bob", "bob-q0")),
        fiber(("q1", "3"), ("q2", "1")),
        fiber(("q2", "2"), ("bob", "bob-q1")),
    ]
    events = [
        event(0, "q1", "open", port="1", detail="1 -> 2"),
        event(10, "alice", "send", photons=10_000),
        event(40, "q1", "close", port="1", detail="1 -> 2"),
        event(60, "q1", "open", port="1", detail="1 -> 3"),
        event(80, "q2", "open", port="1", detail="1 -> 2"),
        event(200, "q1", "close", port="1", detail="1 -> 3"),
    ]
    assert isclose(flapping.dark_share(events, fibers), 0.4)


def test_a_queue_of_one_waits_as_pollaczek_and_khinchine_say() -> None:
    """Constant: half of what exponential holding times of the same mean cost, rho/(1-rho)."""
    assert isclose(head_of_line.mean_wait_s(0.5, [1.0] * 4), 0.5)
    # Two values with the mean and the second moment of an exponential one: 0 and 2, evenly.
    assert isclose(head_of_line.mean_wait_s(0.5, [0.0, 2.0]), 1.0)


def test_the_record_tells_when_each_session_had_light() -> None:
    lines = [("a", "path_ready", 1), ("b", "queued", 2), ("a", "torn_down", 4)]
    lines += [("b", "path_ready", 5), ("c", "queued", 6), ("b", "torn_down", 7)]
    record = [{"session": s, "event": e, "time_ns": t * 10**9} for s, e, t in lines]
    assert head_of_line.lights(record) == {"a": (1, 1, 4), "b": (2, 5, 7)}
