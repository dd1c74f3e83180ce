"""Distributed sensing between whole stacks over loopback, and its estimate, beside closed forms."""

from collections.abc import Iterator
from math import cos, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from line_scene import LINE as ALL
from line_scene import summaries

from applications.sensing.fringe import Fringe, in_rad, in_steps
from applications.sensing.protocol import SensingOptions
from hosts.middleware.session.errors import SessionError
from wire.parameters.physics import Detectors, Device, Sensor

LINE = ALL[:3]
PHASES = [0.4, -1.1, 2.0]  # of alice, bob and charlie
SUM = 1.3


def sensed(
    folder: Path, count: int = 4000, probes: str = "ghz", efficiency: float = 1.0, **physics: Any
) -> list[dict[str, Any]]:
    """Return the summaries of all hosts, in their order."""
    detectors = Detectors(efficiency=efficiency)
    devices = {
        name: Device(detectors=detectors, sensor=Sensor(phase))
        for name, phase in zip(LINE, PHASES, strict=True)
    }
    words = {"count": count, "probes": probes}
    return summaries(folder, "sense", LINE, words, devices=devices, **physics)


def off(report: dict[str, Any], total: float) -> float:
    """Return by how much the sum is wrong, on the circle."""
    return float((report["sum_rad"] - total + pi) % (2 * pi) - pi)


def test_the_sum_of_phases_is_told_at_the_limit_of_heisenberg(tmp_path: Path) -> None:
    """1 / (N sqrt M) of the mean, as far as 125 states in X and 125 in Y tell the visibility."""
    alice, bob, charlie = sensed(tmp_path)
    assert alice["states"] == bob["states"] == charlie["states"] == 4000
    assert abs(off(alice, SUM)) < 5 / sqrt(4000)
    assert alice["mean_rad"] == pytest.approx(alice["sum_rad"] / 3)
    assert alice["heisenberg_limit_rad"] == pytest.approx(1 / (3 * sqrt(4000)))
    assert alice["standard_limit_rad"] == pytest.approx(1 / sqrt(3 * 4000))
    assert abs(alice["mean_error_rad"] / alice["heisenberg_limit_rad"] - 1) < 5 * sqrt(1 / 250)
    assert alice["visibility"] == pytest.approx(1, abs=5 * sqrt(1 / 125))


def test_separate_probes_tell_it_at_the_standard_limit(tmp_path: Path) -> None:
    """1 / sqrt(N M): each phase by its own M probes; nothing is emitted over fibres."""
    alice, bob, _charlie = sensed(tmp_path, probes="separate")
    assert (alice["states"], bob["states"], bob["fused"]) == (4000, 4000, 0)
    assert abs(off(alice, SUM)) < 5 * sqrt(3 / 4000)
    assert abs(alice["mean_error_rad"] / alice["standard_limit_rad"] - 1) < 5 * sqrt(1 / 250)


def test_noise_of_fibers_costs_visibility_and_the_error_grows_by_as_much(tmp_path: Path) -> None:
    """Coherence (1 - p)^2 of two links (as the witness of GHZ states has it): error 1/(V sqrt M).

    Each link is two fibres, host to switch and switch to host.
    """
    alice, *_others = sensed(tmp_path, count=8000, depolarizing=0.1)
    visibility = (1 - 0.1) ** 4
    assert abs(off(alice, SUM)) < 5 / (visibility * sqrt(8000))
    assert abs(alice["visibility"] - visibility) < 5 * sqrt(1 / 250)
    assert alice["sum_error_rad"] * sqrt(8000) * alice["visibility"] == pytest.approx(1, abs=0.1)


def test_a_state_that_a_detector_missed_tells_nothing(tmp_path: Path) -> None:
    """A state is seen with the cube of the efficiency, and its fusion with one more."""
    alice, bob, _charlie = sensed(tmp_path, count=1000, efficiency=0.8)
    assert alice["visibility"] == pytest.approx(1, abs=5 * sqrt(1 / 31))
    share, spread = alice["states"] / alice["made"], sqrt(0.512 * 0.488 / alice["made"])
    assert abs(share - 0.512) < 5 * spread
    assert abs(alice["made"] / bob["fused"] - 0.8) < 5 * sqrt(0.16 / bob["fused"])


def test_probes_that_are_not_known_are_refused() -> None:
    options = SensingOptions("bob", 9, probes="squeezed")
    with pytest.raises(SessionError, match="probes 'squeezed': choose one of ghz, separate"):
        options.check()


def estimates(phase: float, visibility: float, count: int, runs: int) -> Iterator[Fringe]:
    """Yield fringes of probes drawn by their probabilities, measured as the hosts do."""
    draws = np.random.default_rng(7)
    for _ in range(runs):
        fringe, left = Fringe(), count
        for size in (count // 32, count // 32, count // 4, count):
            steps = fringe.next_steps()
            even = (1 + visibility * cos(phase - in_rad(steps))) / 2
            fringe.add(steps, (draws.random(min(size, left)) >= even).astype(np.uint8))
            left -= min(size, left)
        yield fringe


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("phase", [0.0, pi / 4, -2.5, pi])
@pytest.mark.parametrize("visibility", [1.0, 0.6])
def test_the_spread_of_estimates_is_the_bound_of_cramer_and_rao(
    phase: float, visibility: float
) -> None:
    """1/(V^2 n), wherever the phase is: 600 estimates tell a variance to 1/sqrt(300), 6 %.

    One in 32 of the probes is of no use for the phase. The estimate has the visibility from the 100
    in X and 100 in Y alone: it is too careful rather than too sure.
    """
    found = [fringe.phase() for fringe in estimates(phase, visibility, 3200, 600)]
    wrong = (np.array([each.phase_rad for each in found]) - phase + pi) % (2 * pi) - pi
    bound = 1 / (visibility**2 * 3200)
    assert 1 - 5 / sqrt(300) < (wrong**2).mean() / bound < 1.04 + 5 / sqrt(300)
    report = np.mean([each.error_rad**2 for each in found]) / bound
    assert 1 < report < 1.2
    assert abs(wrong.mean()) < 5 * sqrt(bound / 600)
    assert np.mean([each.visibility for each in found]) == pytest.approx(visibility, abs=0.02)


def test_angles_travel_as_parts_of_a_turn() -> None:
    for angle in (-3.0, -0.1, 0.0, 1.0, 3.1):
        assert (in_rad(in_steps(angle)) - angle + pi) % (2 * pi) - pi == pytest.approx(0, abs=1e-9)
    assert in_steps(-1e-12) == 0  # not a whole turn, which no value may be
