"""Detectors against closed forms, within 5 standard errors; the seed is 1."""

from dataclasses import replace
from math import erf, sqrt
from typing import Any

import numpy as np
import pytest
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.devices.detector import Detector, Train
from dispatcher.devices.detectors import Detection, DetectorPair, ExtraBits
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.draws import Draws
from wire.outcomes import NO_CLICK
from wire.parameters.physics import Detectors

COUNT = 200_000
START_NS = 1_700_000_000_000_000_000
TRAIN = Train(START_NS, 20.0, COUNT)
DARK = np.full(COUNT, NO_CLICK, dtype=np.uint8)
BITS = np.random.default_rng(1).integers(0, 2, COUNT, dtype=np.uint8)


class NoDraws:
    """Draws that must not be made."""

    def generator(self, _key: tuple[int, int, int], purpose: str) -> np.random.Generator:
        """Fail."""
        raise AssertionError(f"drew for {purpose}")

    def digest(self, _key: tuple[int, int, int], purpose: str) -> bytes:
        """Fail."""
        raise AssertionError(f"drew for {purpose}")


def random(number: int = 0, count: int = COUNT) -> PhotonRandom:
    """Return the draws of a block."""
    return PhotonRandom(Draws(1), (7, number, 0), "detectors", count)


def look(bits: NDArray[np.uint8] = BITS, train: Train = TRAIN, **device: Any) -> Detection:
    """Look at light with detectors like this."""
    return DetectorPair(Detectors(**device)).detect(bits, None, train, random(count=train.count))


def test_ideal_detectors_tell_the_bits_and_draw_nothing() -> None:
    nothing = PhotonRandom(NoDraws(), (7, 0, 0), "detectors", COUNT)
    found = DetectorPair(Detectors()).detect(BITS, None, TRAIN, nothing)
    assert found.bits is BITS
    assert (found.clicks, found.incidents()) == (COUNT, {})


def test_light_is_seen_with_the_efficiency() -> None:
    found = look(efficiency=0.8)
    seen = found.bits != NO_CLICK
    assert within(int(seen.sum()), COUNT, 0.8)
    assert np.array_equal(found.bits[seen], BITS[seen])
    assert found.clicks == seen.sum()


@pytest.mark.parametrize("dark_count_hz", [1e5, 1e8])
def test_dark_counts_come_with_their_rate_while_the_gate_is_open(dark_count_hz: float) -> None:
    found = look(DARK, dark_count_hz=dark_count_hz, gate_s=2e-9)
    expected = 1 - np.exp(-dark_count_hz * 2e-9)
    assert within(found.dark, 2 * COUNT, expected)
    assert found.clicks == found.dark
    report = found.bits[found.bits != NO_CLICK]
    assert within(len(report), COUNT, 1 - (1 - expected) ** 2)
    assert within(int(report.sum()), len(report), 0.5)
    assert found.lightless is not None
    assert np.array_equal(found.lightless, found.bits != NO_CLICK)


def test_two_clicks_at_once_are_squashed_to_a_random_bit() -> None:
    zeros = np.zeros(COUNT, dtype=np.uint8)
    found = look(zeros, dark_count_hz=5e8, gate_s=1e-9)
    dark = 1 - np.exp(-0.5)
    assert within(found.double, COUNT, dark)
    assert within(int(found.bits.sum()), COUNT, dark / 2)


def test_extra_pairs_photons_of_a_pulse_click_in_either_detector() -> None:
    """With n photons and efficiency e, neither clicks with (1-e)^n, both with what is left."""
    extras = np.full(COUNT, 2, dtype=np.uint8)
    found = DetectorPair(Detectors(efficiency=0.6)).detect(DARK, extras, TRAIN, random())
    assert within(int((found.bits == NO_CLICK).sum()), COUNT, 0.4**2)
    assert within(found.double, COUNT, 1 - 2 * 0.7**2 + 0.4**2)
    assert within(int((found.bits == 1).sum()), COUNT, (1 - 0.4**2) / 2)
    assert not found.own.any()


def test_each_detector_is_dead_on_its_own() -> None:
    alternating = (np.arange(COUNT) % 2).astype(np.uint8)
    assert look(alternating, dead_time_s=40e-9).dead == 0  # the same detector every 40 ns
    assert look(np.zeros_like(alternating), dead_time_s=40e-9).dead == COUNT // 2


def test_the_dead_time_goes_on_into_the_next_block() -> None:
    pair = DetectorPair(Detectors(dead_time_s=1e-6))
    zeros = np.zeros(3, dtype=np.uint8)

    def seen(start_ns: int) -> list[int]:
        train = Train(START_NS + start_ns, 20.0, 3)
        return list(pair.detect(zeros, None, train, random(count=3)).bits)

    assert seen(0) == [0, NO_CLICK, NO_CLICK]
    assert seen(960) == [NO_CLICK, NO_CLICK, 0]  # live again at 1000 ns
    assert seen(5_000) == [0, NO_CLICK, NO_CLICK]


@pytest.mark.parametrize(("slots", "every"), [(1.5, 2), (2.0, 2), (2.5, 3), (2.999, 3), (3.0, 3)])
def test_a_detector_is_dead_for_no_less_than_its_time(slots: float, every: int) -> None:
    """A pulse that comes before the dead time is over is not seen, by however little."""
    found = look(np.zeros(COUNT, dtype=np.uint8), dead_time_s=slots * 20e-9)
    assert np.array_equal(np.flatnonzero(found.bits == 0), np.arange(0, COUNT, every))


def test_a_dead_time_from_the_block_before_ends_within_a_slot() -> None:
    """A click at 0 and 50 ns of dead time: of pulses at 20, 40 and 60 ns the last is seen."""
    pair = DetectorPair(Detectors(dead_time_s=50e-9))
    pair.detect(np.zeros(1, np.uint8), None, Train(START_NS, 20.0, 1), random(count=1))
    train = Train(START_NS + 20, 20.0, 3)
    found = pair.detect(np.zeros(3, np.uint8), None, train, random(count=3))
    assert list(found.bits) == [NO_CLICK, NO_CLICK, 0]


def test_light_that_was_in_no_fibre_is_measured_at_leisure() -> None:
    train = replace(TRAIN, interval_ns=0.0)
    found = look(train=train, dead_time_s=1e-3, afterpulse_probability=0.5)
    assert np.array_equal(found.bits, BITS)


def test_afterpulses_are_a_share_of_the_clicks() -> None:
    """Those within half a slot of their click fall into its own gate and are not seen."""
    light = DARK.copy()
    light[::200] = 0
    found = look(light, gate_s=20e-9, afterpulse_probability=0.3, afterpulse_s=100e-9)
    assert within(found.afterpulses, COUNT // 200, 0.3 * np.exp(-10 / 100))
    assert found.clicks == COUNT // 200 + found.afterpulses


def test_afterpulses_outside_the_gates_are_not_seen() -> None:
    light = DARK.copy()
    light[::200] = 0
    found = look(light, gate_s=5e-9, afterpulse_probability=1.0, afterpulse_s=1e-6)
    assert abs(found.afterpulses - COUNT / 200 * 0.25) < 5 * (COUNT / 200 * 0.25) ** 0.5


def test_afterpulses_of_a_block_are_seen_in_the_next() -> None:
    detector = Detector(Detectors(gate_s=20e-9, afterpulse_probability=1.0, afterpulse_s=1e-4))
    light, dark = np.arange(1_000), np.zeros(0, np.int64)
    first = detector.watch(light, Train(START_NS, 20.0, 1_000), random(0, 1_000))
    assert first.seen.size == 1_000
    later = detector.watch(dark, Train(START_NS + 20_000, 20.0, 100_000), random(1, 100_000))
    # All 1,000 but those that came already: 1 - E[e^(-u)], u uniform over 0 to .2.
    assert within(later.afterpulses, 1_000, (1 - np.exp(-0.2)) / 0.2)
    again = detector.watch(dark, Train(START_NS + 3_000_000, 20.0, 100_000), random(2, 100_000))
    assert again.afterpulses == 0


@pytest.mark.parametrize("dead_slots", [1, 2, 7])
def test_dead_time_and_afterpulses_together_are_as_one_after_the_other(dead_slots: int) -> None:
    count = 20_000
    device = Detectors(
        gate_s=20e-9,
        dead_time_s=dead_slots * 20e-9,
        afterpulse_probability=0.4,
        afterpulse_s=100e-9,
    )
    light = np.random.default_rng(1).random(count) < 0.3
    drawn = random(0, count)
    train = Train(START_NS, 20.0, count)
    found = Detector(device).watch(np.flatnonzero(light), train, drawn)
    causes = drawn.events("afterpulse", 0.4)
    waits = drawn.generator("afterpulse delay").standard_exponential(causes.size) * 5
    target = dict(zip(causes.tolist(), np.rint(causes + waits).astype(int).tolist(), strict=True))
    pulses, expected, last = set[int](), np.zeros(count, dtype=bool), -dead_slots
    for slot in range(count):
        if slot - last >= dead_slots and (light[slot] or slot in pulses):
            expected[slot], last = True, slot
            if light[slot] and slot in target:
                pulses.add(target[slot])
    assert np.array_equal(found.seen, np.flatnonzero(expected))


def test_the_same_block_is_seen_the_same_whatever_was_measured_before() -> None:
    device = Detectors(efficiency=0.7, dark_count_hz=1e7)
    alone, second = DetectorPair(device), DetectorPair(device)
    second.detect(BITS, None, TRAIN, random(1))
    one, other = (pair.detect(BITS, None, TRAIN, random(2)) for pair in (alone, second))
    assert np.array_equal(one.bits, other.bits)


@pytest.mark.parametrize("mismatch", [0.3, 1.0])
def test_one_detector_sees_less_than_the_other(mismatch: float) -> None:
    efficiency = 0.8
    found = look(efficiency=efficiency, efficiency_mismatch=mismatch)
    seen = found.bits != NO_CLICK
    assert (found.bits[seen] == BITS[seen]).all()
    for bit, likely in ((0, efficiency), (1, efficiency * (1 - mismatch))):
        own = bit == BITS
        assert within(int(np.count_nonzero(seen & own)), int(np.count_nonzero(own)), likely)


def test_photons_of_a_pulse_have_each_a_jitter_of_its_own() -> None:
    """Each is in the gate with p = erf(half / (sqrt(2) sigma)): both are not with (1 - p)^2."""
    jitter_ps, gate_s = 1e3, 1e-9
    train = Train(START_NS, 1e6, COUNT)  # so far apart that none is on another slot
    device = Detectors(jitter_ps=jitter_ps, gate_s=gate_s)
    zeros = np.zeros(COUNT, np.uint8)
    extra_pairs = ExtraBits(np.arange(COUNT), zeros)
    found = DetectorPair(device).detect(zeros, None, train, random(), extra_pairs, timed=True)
    in_gate = erf(gate_s * 5e11 / (sqrt(2) * jitter_ps))
    assert within(int((found.bits == 0).sum()), COUNT, 1 - (1 - in_gate) ** 2)


def test_so_it_is_with_photons_that_have_no_state_and_with_extra_pairs_ones() -> None:
    """Two photons each in either detector, of .6 and .3: none clicks in the first with .7^2."""
    device = Detectors(efficiency=0.6, efficiency_mismatch=0.5)
    noise = np.full(COUNT, 2, dtype=np.uint8)
    found = DetectorPair(device).detect(DARK, noise, TRAIN, random())
    neither = (1 - 0.45) ** 2
    only_zero, only_one = (1 - 0.15) ** 2 - neither, (1 - 0.3) ** 2 - neither
    both = 1 - neither - only_zero - only_one
    assert within(int((found.bits == NO_CLICK).sum()), COUNT, neither)
    assert within(int((found.bits == 0).sum()), COUNT, only_zero + both / 2)
    assert within(int((found.bits == 1).sum()), COUNT, only_one + both / 2)
    ones = ExtraBits(np.arange(COUNT), np.ones(COUNT, np.uint8))
    extra_pairs = DetectorPair(device).detect(DARK, None, TRAIN, random(), ones)
    assert within(int((extra_pairs.bits == 1).sum()), COUNT, 0.3)
    assert not (extra_pairs.bits == 0).any()
