"""Bell analysers against closed forms, within 5 standard errors; the seed is 1."""

from dataclasses import replace

import numpy as np
import pytest
from five_sigma import within
from numpy.typing import NDArray
from test_detectors import COUNT, TRAIN, NoDraws

from dispatcher.devices.analyser import Analyser, Analysis, Half
from dispatcher.devices.detector import Train
from dispatcher.devices.detectors import DetectorPair, ExtraBits
from dispatcher.devices.overlap import Spectrum, angular_width, overlap
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.draws import Draws
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BellAnalyser, Detectors, Device

STATES = np.random.default_rng(1).integers(0, 4, COUNT, dtype=np.uint8)
NONE = np.full(COUNT, NO_CLICK, dtype=np.uint8)
LIGHT = Half(np.ones(COUNT, dtype=bool), None, None, TRAIN)
DARKNESS = Half(np.zeros(COUNT, dtype=bool), None, None, TRAIN)
CHANCE = PhotonRandom(Draws(1), (7, 0, 0), "analyser", COUNT)


def analyse(
    analyser: BellAnalyser = BellAnalyser(),  # noqa: B008 - frozen
    detectors: Detectors = Detectors(),  # noqa: B008
    states: NDArray[np.uint8] = STATES,
    halves: tuple[Half, Half] = (LIGHT, LIGHT),
    random: PhotonRandom = CHANCE,
) -> Analysis:
    """Analyse pairs with devices like this."""
    arms = DetectorPair(detectors), DetectorPair(detectors)
    device = Device(detectors=detectors, analyser=analyser)
    light = overlap(Spectrum(), Spectrum(), analyser.bandwidth_rad_per_s)
    return Analyser(device, arms).analyse(states, halves, random, light)


def late(delay_ps: float | NDArray[np.float64]) -> Half:
    """Return light that has come later."""
    return replace(LIGHT, delays_ps=np.broadcast_to(delay_ps, COUNT).astype(np.float64))


def test_a_complete_analyser_tells_all_states_and_draws_nothing() -> None:
    nothing = PhotonRandom(NoDraws(), (7, 0, 0), "analyser", COUNT)
    found = analyse(random=nothing)
    assert np.array_equal(found.outcomes, STATES)
    assert (found.clicks, found.incidents) == (2 * COUNT, {})


def test_linear_optics_tell_psi_apart_and_report_both_phi_as_phi_plus() -> None:
    outcomes = analyse(BellAnalyser(kind="linear")).outcomes
    assert np.array_equal(outcomes, np.array([0, 1, 0, 3], dtype=np.uint8)[STATES])


@pytest.mark.parametrize("extra_pairs", [False, True])
def test_unlike_detectors_do_not_tell_linear_optics_what_these_cannot_tell(
    extra_pairs: bool,
) -> None:
    """By enumeration: Phi reaches either detector of the phase, which see 1 and 1 - m of it."""
    mismatch, light = 0.8, (LIGHT, LIGHT)
    detectors, analyser = Detectors(efficiency_mismatch=mismatch), BellAnalyser(kind="linear")
    states = STATES
    if extra_pairs:  # the same pairs, as those beside the own ones of their pulses
        device, every = Device(detectors=detectors, analyser=analyser), np.arange(COUNT)
        arms = DetectorPair(detectors), DetectorPair(detectors)
        found = Analyser(device, arms).at_detectors(STATES, CHANCE.at("further"))
        report = ExtraBits(every, found >> np.uint8(1)), ExtraBits(every, found & np.uint8(1))
        light = replace(DARKNESS, extra_pairs=report[0]), replace(DARKNESS, extra_pairs=report[1])
        states = NONE
    outcomes = analyse(analyser, detectors, states, light).outcomes
    seen = {0: 1 - mismatch / 2, 1: 1 - mismatch, 2: 1 - mismatch / 2, 3: (1 - mismatch) ** 2}
    for state, chance in seen.items():
        own = outcomes[state == STATES]
        assert within(int((own != NO_CLICK).sum()), own.size, chance)
        assert set(np.unique(own)) == {state if state % 2 else 0, NO_CLICK}


@pytest.mark.parametrize("visibility", [1.0, 0.9])
@pytest.mark.parametrize("mismatch_ps", [0.0, 5.0, -10.0, 100.0])
def test_phases_flip_as_hong_ou_and_mandel_count_coincidences(
    visibility: float, mismatch_ps: float
) -> None:
    """P = [1 - V0 exp(-(bandwidth * mismatch)^2)] / 2."""
    analyser = BellAnalyser(visibility=visibility, bandwidth_rad_per_s=1e11)
    found = analyse(analyser, halves=(late(30.0 + mismatch_ps), late(30.0)))
    flipped = found.outcomes ^ STATES
    assert not (flipped & 1).any()
    expected = (1 - visibility * np.exp(-((0.1 * mismatch_ps) ** 2))) / 2
    assert within(int((flipped == 2).sum()), COUNT, expected)
    assert found.incidents.get("distinguishable", 0) == (flipped == 2).sum()


def test_each_photons_own_mismatch_counts() -> None:
    """The mean of P over mismatches of rms s: V = V0 / sqrt(1 + 2 (bandwidth s)^2)."""
    jitter_ps = np.random.default_rng(1).standard_normal(COUNT) * 8
    found = analyse(BellAnalyser(bandwidth_rad_per_s=1e11), halves=(late(jitter_ps), LIGHT))
    flipped = int(((found.outcomes ^ STATES) == 2).sum())
    assert within(flipped, COUNT, (1 - 1 / (1 + 2 * 0.8**2) ** 0.5) / 2)
    shared = analyse(BellAnalyser(bandwidth_rad_per_s=1e11), halves=(late(jitter_ps),) * 2)
    assert np.array_equal(shared.outcomes, STATES)


RAD_PER_PS = 2 * np.pi * 193.4e12**2 / 299_792_458 * 1e-9 * 1e-12  # 1 nm is 2 pi 124.8 GHz
OMEGA = np.linspace(-6, 6, 400_001)  # rad/ps


def amplitude(light: Spectrum, later_ps: float = 0.0) -> NDArray[np.complex128]:
    """Return a Gaussian amplitude whose intensity has this rms width, dispersed and late."""
    off = OMEGA - 2 * np.pi * (light.frequency_mhz - 193_400_000) * 1e-6
    chirp = -light.dispersion_ps_per_nm / RAD_PER_PS  # a higher frequency is a shorter wave
    phase = 0.5j * chirp * off**2 + 1j * off * later_ps
    spectrum = np.exp(-((off / (2 * light.bandwidth_nm * RAD_PER_PS)) ** 2) + phase)
    return np.asarray(spectrum / np.sqrt((np.abs(spectrum) ** 2).sum()))


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("widths_nm", [(0.1, 0.1), (0.1, 0.3)])
@pytest.mark.parametrize("dispersion_ps_per_nm", [(0.0, 0.0), (170.0, 0.0), (170.0, -340.0)])
@pytest.mark.parametrize("apart_ps", [0.0, 5.0, -40.0])
@pytest.mark.parametrize("apart_ghz", [0.0, 12.5, -50.0])
def test_photons_overlap_as_the_integral_of_their_amplitudes(
    widths_nm: tuple[float, float],
    dispersion_ps_per_nm: tuple[float, float],
    apart_ps: float,
    apart_ghz: float,
) -> None:
    """Against the sum of <1|2> over frequencies."""
    colours = 193_400_000, 193_400_000 + round(apart_ghz * 1e3)
    one, other = map(Spectrum, widths_nm, dispersion_ps_per_nm, colours)
    summed = abs((amplitude(one, apart_ps).conj() * amplitude(other)).sum()) ** 2
    found = overlap(one, other, 0.0)
    assert found.apart(apart_ps) == pytest.approx(summed, rel=1e-6, abs=1e-12)
    assert found.least(abs(apart_ps)) <= found.apart(apart_ps) * (1 + 1e-9) + 1e-12


def test_where_one_width_alone_is_known_both_photons_are_as_wide() -> None:
    """Then exp(-(s tau)^2) of them overlaps, as of equal spectra."""
    known, unknown = Spectrum(0.5), Spectrum()
    width_rad_per_s, apart_ps = angular_width(0.5), 1.5
    expected = np.exp(-((width_rad_per_s * apart_ps * 1e-12) ** 2))
    assert overlap(known, unknown, 0.0).apart(apart_ps) == pytest.approx(expected)
    assert overlap(unknown, known, 0.0).apart(apart_ps) == pytest.approx(expected)


def test_light_of_two_colours_without_a_width_does_not_overlap() -> None:
    one, other = Spectrum(0.0, 0.0, 193_400_000), Spectrum(0.0, 0.0, 193_412_500)
    assert overlap(one, other, 0.0).apart(0.0) == 0.0
    assert overlap(one, one, 0.0).apart(1e6) == overlap(one, Spectrum(), 0.0).apart(1e6) == 1.0


def test_a_nanometre_is_125_gigahertz() -> None:
    """The usual rule at 1550 nm: .8 nm are 100 GHz."""
    assert angular_width(0.8) / (2 * np.pi) == pytest.approx(100e9, rel=0.005)


def test_pairs_that_lack_a_photon_are_no_coincidence() -> None:
    there = np.arange(COUNT) % 2 == 0
    states = np.where(there, STATES, np.uint8(NO_CLICK))
    found = analyse(states=states, halves=(LIGHT, replace(LIGHT, present=there)))
    assert np.array_equal(found.outcomes, states)
    assert found.clicks == COUNT + COUNT // 2


def test_both_photons_must_be_detected() -> None:
    outcomes = analyse(detectors=Detectors(efficiency=0.7)).outcomes
    seen = outcomes != NO_CLICK
    assert within(int(seen.sum()), COUNT, 0.7**2)
    assert np.array_equal(outcomes[seen], STATES[seen])


@pytest.mark.parametrize("error", [0.01, 0.2])
def test_either_arm_tells_its_bit_wrongly_by_itself(error: float) -> None:
    """Right with (1 - e)^2; of either bit alone wrong with e (1 - e), of both with e^2."""
    found = analyse(detectors=Detectors(readout_error=error))
    flips = found.outcomes ^ STATES
    right = (1 - error) ** 2, error * (1 - error), error * (1 - error), error**2
    assert all(within(int((flips == each).sum()), COUNT, right[each]) for each in range(4))
    assert found.incidents == {"misread": int(np.count_nonzero(flips))}
    linear = analyse(BellAnalyser("linear"), Detectors(readout_error=error)).outcomes
    psi_plus = STATES == 1
    reports = dict(zip(range(4), (error, right[0], 0.0, right[2]), strict=True))
    for outcome, chance in reports.items():
        count = int((linear[psi_plus] == outcome).sum())
        assert within(count, int(psi_plus.sum()), chance)


def test_what_is_no_coincidence_is_not_made_one_by_a_wrong_reading() -> None:
    found = analyse(detectors=Detectors(readout_error=0.5), states=NONE, halves=(LIGHT, DARKNESS))
    assert (found.outcomes == NO_CLICK).all()
    assert found.incidents == {}


def test_dark_counts_alone_make_accidental_coincidences_of_any_outcome() -> None:
    detectors = Detectors(dark_count_hz=1e8, gate_s=1e-9)
    found = analyse(detectors=detectors, states=NONE, halves=(DARKNESS, DARKNESS))
    arm = 1 - np.exp(-2 * 0.1)
    count = int((found.outcomes != NO_CLICK).sum())
    assert within(count, COUNT, arm**2)
    assert found.incidents["accidental"] == count
    assert within(found.incidents["dark"], 4 * COUNT, 1 - np.exp(-0.1))  # of two pairs of detectors
    assert all(within(int((found.outcomes == state).sum()), count, 0.25) for state in range(4))


def test_a_short_window_keeps_part_of_the_accidental_coincidences() -> None:
    """Two moments in a gate of g are within w with probability 1 - (1 - w/g)^2."""
    detectors = Detectors(dark_count_hz=1e8, gate_s=1e-9)
    found = analyse(
        BellAnalyser(coincidence_window_s=0.3e-9), detectors, NONE, (DARKNESS, DARKNESS)
    )
    count = int((found.outcomes != NO_CLICK).sum())
    assert within(count, COUNT, (1 - np.exp(-0.2)) ** 2 * (1 - 0.7**2))


def test_a_dark_count_beside_a_lone_photon_is_an_accidental_coincidence() -> None:
    detectors = Detectors(dark_count_hz=1e8, gate_s=1e-9)
    found = analyse(detectors=detectors, states=NONE, halves=(LIGHT, DARKNESS))
    count = int((found.outcomes != NO_CLICK).sum())
    assert within(count, COUNT, 1 - np.exp(-0.2))
    assert found.incidents["accidental"] == count
    assert all(within(int((found.outcomes == state).sum()), count, 0.25) for state in range(4))


def test_clicks_too_far_apart_are_no_coincidence() -> None:
    delays_ps = np.where(np.arange(COUNT) % 4 == 0, 2e6, 0.0)
    found = analyse(halves=(late(delays_ps), LIGHT))
    assert np.array_equal(found.outcomes == NO_CLICK, np.arange(COUNT) % 4 == 0)
    assert found.incidents == {"late": COUNT // 4}


def test_the_jitter_of_both_detectors_takes_clicks_apart() -> None:
    """Of a normal difference of rms s, erf(w / (s sqrt 2)) is within w; here w = s."""
    detectors = Detectors(jitter_ps=100.0)
    window_s = 100e-12 * 2**0.5
    found = analyse(BellAnalyser(coincidence_window_s=window_s), detectors)
    assert within(int((found.outcomes != NO_CLICK).sum()), COUNT, 0.6826895)


def test_trains_of_different_rates_run_apart() -> None:
    slower = replace(LIGHT, train=Train(TRAIN.start_ns + 5_000_000, 40.0, COUNT))
    found = analyse(halves=(LIGHT, slower))
    assert np.flatnonzero(found.outcomes != NO_CLICK).tolist() == list(range(51))  # 1 us at 20 ns


def test_the_delay_line_takes_out_how_much_later_one_half_has_come() -> None:
    delayed = replace(LIGHT, train=replace(TRAIN, start_ns=TRAIN.start_ns + 5_000_000))
    assert np.array_equal(analyse(halves=(LIGHT, delayed)).outcomes, STATES)


def test_extra_pairs_photons_make_outcomes_random() -> None:
    extras = np.ones(COUNT, dtype=np.uint8)
    half = replace(DARKNESS, extras=extras)
    found = analyse(states=NONE, halves=(half, half))
    assert all(within(int((found.outcomes == state).sum()), COUNT, 0.25) for state in range(4))
    assert found.incidents["accidental"] == COUNT
