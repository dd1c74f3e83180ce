"""Noise with a memory against its closed forms, within 5 standard errors; the seed is 1."""

import numpy as np
import pytest
from noise_cases import COUNT, START_NS, passage, within
from numpy.typing import NDArray

from dispatcher.fiber import fiber_noise
from dispatcher.fiber.fluctuations import Bursts, PhaseDrift, ThermalDrift
from dispatcher.fiber.noise import NoiseHistory
from wire.parameters.fiber import optics

RUNS = 4_000
SECOND_NS = 1_000_000_000


def angles(
    model: PhaseDrift, history: NoiseHistory, number: int, first_ns: int, k: int
) -> NDArray[np.float64]:
    """Return the angles of a block of k photons at 50 MHz."""
    block = passage(photons=k, first_ns=first_ns, history=history, number=number)
    found = model.effect(block).angles_rad
    assert found is not None
    return found


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("lag", [0.0, 0.1, 0.5, 2.0])
def test_polarisation_drift_has_the_rms_and_the_correlation_of_ornstein_uhlenbeck(
    lag: float,
) -> None:
    rms, time_s = 0.3, 0.01
    model, pairs = PhaseDrift(rms, time_s), []
    for run in range(RUNS):
        history = NoiseHistory(100)
        one = angles(model, history, 2 * run, START_NS, 1)[0]
        later_ns = START_NS + round(lag * time_s * SECOND_NS)
        pairs.append((one, angles(model, history, 2 * run + 1, later_ns, 1)[0]))
    first, second = np.array(pairs).T
    for values in (first, second):
        assert abs(values.mean()) < 5 * rms / RUNS**0.5
        assert abs((values**2).mean() - rms**2) < 5 * rms**2 * (2 / RUNS) ** 0.5
    correlation = float(np.exp(-lag))
    error = rms**2 * ((1 + correlation**2) / RUNS) ** 0.5
    assert abs((first * second).mean() - rms**2 * correlation) < 5 * error


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("time_s", [1e-9, 1e-7, 1e-4])
def test_within_a_long_block_the_angle_wanders_as_in_many_short_ones(time_s: float) -> None:
    rms, interval_s = 0.2, 20e-9
    found = angles(PhaseDrift(rms, time_s), NoiseHistory(100), 0, START_NS, 5_000_000)
    independent = len(found) * min(interval_s / time_s, 1.0)
    assert abs(found.mean()) < 5 * rms * (2 / independent) ** 0.5
    assert abs((found**2).mean() - rms**2) < 5 * rms**2 * (2 / independent) ** 0.5
    lag = max(round(time_s / interval_s), 1)
    correlation = (found[lag:] * found[:-lag]).mean() / rms**2
    expected = np.exp(-lag * interval_s / time_s)
    assert abs(correlation - expected) < 5 * (4 / independent) ** 0.5


def test_blocks_close_in_time_meet_nearly_the_same_angle() -> None:
    model, history = PhaseDrift(1.0, 100.0), NoiseHistory(100)
    one = angles(model, history, 0, START_NS, COUNT)
    other = angles(model, history, 1, START_NS + SECOND_NS // 100, COUNT)
    assert np.ptp(np.concatenate([one, other])) < 5 * (2 * 0.014 / 100) ** 0.5
    assert np.ptp(one) == 0  # they last 4 ms


def test_the_same_light_again_meets_what_was_there() -> None:
    model, history = PhaseDrift(1.0, 1e-9), NoiseHistory(COUNT)
    one = angles(model, history, 0, START_NS, 1000)
    assert (angles(model, history, 1, START_NS, 1000) == one).all()
    half = angles(model, history, 2, START_NS + 500 * 20, 1000)
    assert (half[:500] == one[500:]).all()
    assert len(set(half.tolist())) == 1000


def test_without_history_a_channel_has_no_memory() -> None:
    model, history = PhaseDrift(1.0, 100.0), NoiseHistory(0)
    one, other = (angles(model, history, number, START_NS, 1)[0] for number in range(2))
    assert abs(one - other) > 0.01
    assert history.latest is None


def test_history_forgets_what_is_older_than_its_depth() -> None:
    history = NoiseHistory(3)
    for time in range(10):
        history.remember(np.array([time]), np.array([time / 10]))
    assert history.latest == (9, 0.9)
    assert history.at(np.array([0, 8, 20])).tolist() == [0.7, 0.8, 0.9]
    history.remember(np.arange(10, 20), np.arange(10, 20) / 10)
    assert history.at(np.array([0])).tolist() == [1.7]


def test_what_is_remembered_late_holds_from_the_latest_time_on() -> None:
    history = NoiseHistory(10)
    history.remember(np.array([5]), np.array([0.5]))
    history.remember(np.array([3, 7]), np.array([0.3, 0.7]))
    assert history.at(np.array([4, 5, 6, 7])).tolist() == [0.5, 0.3, 0.3, 0.7]


@pytest.mark.parametrize("asked", [(0, 100), (20, 30), (0, 5), (95, 100), (50, 51)])
def test_each_time_meets_the_last_value_that_was_remembered_by_then(asked: tuple[int, int]) -> None:
    random, history = np.random.default_rng(1), NoiseHistory(1000)
    values: list[float] = random.random(40).tolist()
    since: list[int] = []
    for begin, end in ((0, 10), (10, 30), (30, 40)):
        times = np.sort(random.integers(10, 90, end - begin))
        history.remember(times, np.array(values[begin:end]))
        since += np.maximum(times, max(since, default=0)).tolist()
    expected = [
        [value for time, value in zip(since, values, strict=True) if time <= now] or values[:1]
        for now in range(*asked)
    ]
    assert history.at(np.arange(*asked)).tolist() == [held[-1] for held in expected]


GOOD_TO_BAD_HZ, BAD_TO_GOOD_HZ = 500.0, 2_000.0
BURSTS = Bursts(1.0, GOOD_TO_BAD_HZ, BAD_TO_GOOD_HZ)
FRACTION = 0.2  # of the time that is bad
FORGET_HZ = GOOD_TO_BAD_HZ + BAD_TO_GOOD_HZ


@pytest.mark.parametrize("interval_ns", [200.0, 50_000.0])
def test_bursts_are_as_frequent_and_as_long_as_their_rates_say(interval_ns: float) -> None:
    count = 5_000_000 if interval_ns < 1000 else 100_000
    bad = BURSTS.states(passage(photons=count, interval_ns=interval_ns))
    seconds = count * interval_ns / 1e9
    error = (FRACTION * (1 - FRACTION) * 2 / (FORGET_HZ * seconds)) ** 0.5
    assert abs(bad.mean() - FRACTION) < 5 * error
    edges = np.flatnonzero(np.diff(bad.astype(np.int8)))
    lengths = np.diff(edges)[int(not bad[edges[0] + 1]) :: 2]
    # Seen at intervals, a burst ends with this probability from one photon to the next.
    forget = 1 - np.exp(-FORGET_HZ * interval_ns / 1e9)
    mean = 1 / (forget * (1 - FRACTION))
    assert len(lengths) > 300
    assert abs(lengths.mean() - mean) < 5 * mean / len(lengths) ** 0.5
    lag = round(1e9 / FORGET_HZ / interval_ns)
    product = (bad[lag:] & bad[:-lag]).mean()
    expected = FRACTION**2 + FRACTION * (1 - FRACTION) * np.exp(
        -lag * FORGET_HZ * interval_ns / 1e9
    )
    assert abs(product - expected) < 5 * error


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("lag", [0.1, 1.0, 10.0])
def test_the_state_is_remembered_between_blocks(lag: float) -> None:
    later_ns = START_NS + 20 + round(lag / FORGET_HZ * SECOND_NS)
    found = []
    for run in range(RUNS):
        history = NoiseHistory(100)
        one = BURSTS.states(passage(2, history=history, number=2 * run))[1]
        other = BURSTS.states(passage(1, first_ns=later_ns, history=history, number=2 * run + 1))[0]
        found.append((one, other))
    first, second = np.array(found).T
    assert within(int(first.sum()), FRACTION, RUNS)
    assert within(int(second.sum()), FRACTION, RUNS)
    expected = FRACTION**2 + FRACTION * (1 - FRACTION) * float(np.exp(-lag))
    assert within(int((first & second).sum()), expected, RUNS)


def test_bursts_depolarise_while_the_channel_is_bad_and_only_then() -> None:
    p = 0.8
    model = Bursts(p, GOOD_TO_BAD_HZ, BAD_TO_GOOD_HZ)
    block = passage(photons=1_000_000, interval_ns=1000.0)
    bad = BURSTS.states(passage(photons=1_000_000, interval_ns=1000.0))
    paulis = model.effect(block).paulis
    assert paulis is not None
    assert not paulis[~bad].any()
    counts = np.bincount(paulis[bad], minlength=4)
    assert all(within(int(count), p / 4, int(bad.sum())) for count in counts[1:])


def test_a_channel_that_never_turns_bad_does_nothing() -> None:
    assert Bursts(1.0, 0.0, 0.0).effect(passage()).paulis is None


def test_a_path_gets_longer_by_40_ps_for_a_kilometre_and_a_kelvin() -> None:
    fiber = optics("it", length_km=1, temperature_slope_k_per_s=1.0)
    (model,) = [m for m in fiber_noise.models(fiber).values() if isinstance(m, ThermalDrift)]
    assert model.ps_per_k == pytest.approx(40, rel=0.01)
    history = NoiseHistory(100)
    model.effect(passage(1, history=history))
    delays = model.effect(passage(1, first_ns=START_NS + 2 * SECOND_NS, history=history)).delays_ps
    assert delays == pytest.approx([2 * model.ps_per_k])


def test_a_wandering_temperature_has_a_variance_that_grows_with_time() -> None:
    walk, found = 0.5, []
    model = ThermalDrift(1.0, 0.0, walk)
    for run in range(RUNS):
        history = NoiseHistory(100)
        assert model.effect(passage(1, history=history, number=2 * run)).delays_ps == [0]
        later = passage(1, first_ns=START_NS + 3 * SECOND_NS, history=history, number=2 * run + 1)
        delays = model.effect(later).delays_ps
        assert delays is not None
        found.append(delays[0])
    variance = walk**2 * 3
    assert abs((np.array(found) ** 2).mean() - variance) < 5 * variance * (2 / RUNS) ** 0.5


def test_within_a_block_the_temperature_goes_on() -> None:
    model = ThermalDrift(1.0, 2.0, 0.0)
    delays = model.effect(passage(photons=1001, interval_ns=1e6)).delays_ps
    assert delays is not None
    assert abs(delays[-1] - 2.0) < 2 / 64
    assert (np.diff(delays) >= 0).all()
