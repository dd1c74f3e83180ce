"""Models that labs compute by themselves, beside enumerations and sums of their own."""

import re
from dataclasses import replace
from itertools import pairwise
from math import exp, factorial
from typing import Any

import pytest

from dispatcher.fiber.classical_light import ClassicalLight
from evidence.curves import theory
from evidence.labs import catalogue
from qmn.network import custom_topology
from wire.parameters.fiber import optics


def globals_of(lab: str) -> dict[str, Any]:
    """Return what the module of a lab has."""
    found: dict[str, Any] = catalogue.lab(lab).findings.__globals__
    return found


def poisson(mean: float, count: int) -> float:
    return exp(-mean) * mean**count / factorial(count)


@pytest.mark.parametrize("light", [0.001, 0.05, 0.3])
def test_the_visibility_of_a_bright_source_is_that_of_all_ways_to_click(light: float) -> None:
    """Photons of other pairs in the right detector and in the wrong one, and the own partner."""
    own = globals_of("city-fibre")
    right = wrong = 0.0
    for others_right in range(20):
        for others_wrong in range(20):
            for partner, chance in ((1, own["NEAR"]), (0, 1 - own["NEAR"])):
                p = poisson(light, others_right) * poisson(light, others_wrong) * chance
                clicks = bool(others_right + partner), bool(others_wrong)
                right += p * {(True, False): 1.0, (True, True): 0.5}.get(clicks, 0.0)
                wrong += p * {(False, True): 1.0, (True, True): 0.5}.get(clicks, 0.0)
    assert own["visibility"](light) == pytest.approx((right - wrong) / (right + wrong), rel=1e-9)


def test_the_light_of_a_rate_makes_the_published_bound_at_the_brightest() -> None:
    own = globals_of("city-fibre")
    assert own["lower"](5e5) == pytest.approx(0.84, abs=1e-9)
    assert own["light"](2e5) == pytest.approx(0.4 * own["light"](5e5))


def loss_db(topo: Any, ways: list[str]) -> float:
    """Return the loss of a way, in fibres and in the switches between them."""
    fibers = [topo.linkInfo(*ends).get("connectors_db", 0.0) for ends in pairwise(ways)]
    switches = [topo.nodeInfo(name)["insertion_loss_db"] for name in ways if name[0] == "q"]
    return float(sum(fibers) + sum(switches))


@pytest.mark.parametrize(
    ("way", "published"),
    [
        ("q1 alice", 7.25),
        ("q1 avery", 8.51),
        ("q1 q2 bailey", 16.6),
        ("q1 q3 charlie", 17.2),
        ("q1 q2 q3 charlie", 27.5),
        ("q1 q3 q2 bailey", 28.0),
    ],
)
def test_ways_over_the_campus_lose_what_the_paper_says(way: str, published: float) -> None:
    topo = custom_topology.load(f"{catalogue.LABS}/recovery/campus.py:Campus", {})()
    assert loss_db(topo, ["source", *way.split()]) == pytest.approx(published)


def test_light_of_all_channels_makes_the_fidelity_of_the_pair_that_it_is_fitted_to() -> None:
    """F = 0.765 of alice and bailey, by the formula above for what comes to alice of her light."""
    lines = catalogue.lab("recovery").runs["wide"].split()
    (mean,) = (float(each.rpartition("=")[2]) for each in lines if "mean_pairs" in each)
    comes = 10**-0.725
    others = mean * comes / 2
    visible = comes * exp(-others) / (1 - (1 - comes) * exp(-2 * others))
    assert (1 + 3 * visible) / 4 == pytest.approx(0.765, abs=1e-4)


def settings_of(band: str, dbm: float) -> dict[str, float]:
    """Return the numbers that a run beside classical light is given, by name."""
    words = globals_of("coexistence")["settings"](band, dbm)
    texts = dict(each.split("=") for each in words[1::2])
    return {name: float(text) for name, text in texts.items() if re.fullmatch(r"[\d.e-]+", text)}


@pytest.mark.parametrize(
    ("band", "dbm", "photons"), [("o-band", 18.7, 5e-5), ("c-band", 0, 0.0248)]
)
def test_alices_fibre_has_the_light_that_both_arms_scatter(
    band: str, dbm: float, photons: float
) -> None:
    """Of 1 mW at 1550 nm: 2e-9 * .4 nm * 1 mW * 7.958 km * .5 ns / 1.2816e-19 J in either arm.

    The kilometres are (e^(-c L) - e^(-q L))/(q - c) at .2 and .16871 dB/km; 7.91 dB come behind.
    """
    given = settings_of(band, dbm)
    own = {name: each for name, each in given.items() if name.startswith("q1-alice.")}
    fiber = optics("it", **{name.partition(".")[2]: each for name, each in own.items()})
    fiber = replace(fiber, pulse_window_s=given["pulse_window_s"])
    came = ClassicalLight(fiber).photons_per_mw * fiber.classical_mw
    assert came == pytest.approx(2 * photons * 10**-0.791, rel=2e-3)
    assert 10 ** (-fiber.loss_db / 10) == pytest.approx(0.09, rel=1e-4)  # of bob's to a detector


def test_noise_of_the_sources_comes_to_detectors_as_equations_s5_to_s7_have_it() -> None:
    """In either of two detectors near bob .0022 * .05, and behind the beam splitter half of all."""
    given = settings_of("o-band", -20)
    photons = {  # in a window, of 1 mW along 10 m
        way: given[f"q1-{way}.raman_per_km_nm"] * 0.4 * 0.01 * 1e-3 * 5e-10 / 1.28149e-19
        for way in ("charlie", "bob")
    }
    near = sum(photons.values()) / 2 * given["bob.detectors.efficiency"]
    assert near == pytest.approx(0.0022 * 0.05, rel=1e-3)
    behind = 10**-0.671 * (0.0027 * 10**-1.081 + 0.0022 * 10**-1.064) / 2
    assert photons["charlie"] / 2 * 0.09 == pytest.approx(behind, rel=1e-3)


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-3])
def test_visibility_of_thermal_pairs_is_that_of_all_numbers_of_pairs(noise: float) -> None:
    """Each number n of them with n^k/(1 + n)^(k + 1), each half lost or not, noise in either."""
    mean, here, there = 0.013, 0.05, 0.09
    both = one = other = 0.0
    for pairs in range(60):
        chance = mean**pairs / (1 + mean) ** (pairs + 1)
        clicks = [1 - (1 - noise) * (1 - share) ** pairs for share in (here, there)]
        both += chance * clicks[0] * clicks[1]
        one, other = one + chance * clicks[0], other + chance * clicks[1]
    expected = (both - one * other) / (both + one * other)
    report = theory.coincidence_visibility(mean, (here, there), (noise, noise))
    assert report == pytest.approx(expected, rel=3e-3)


def test_fidelity_beside_traffic_is_that_of_the_supplement() -> None:
    """Equations S5 to S7 and S13 to S15 by hand, with 5e-5 photons scattered at either arm's end.

    Noise is 5.1305e-4 and 6.6725e-5 in alice's detectors, 1.1005e-4 and 5.2285e-5 in bob's.
    """
    visible = 1.0
    for mean, near, far, stray, noise in (
        (0.018, 0.19, 0.07, 5.1305e-4, 6.6725e-5),
        (0.013, 0.05, 0.09, 1.1005e-4, 5.2285e-5),
    ):
        accidental = (near * mean + stray) * (far * mean + noise)
        coincident = near * far * (mean + mean**2) + accidental
        visible *= (coincident - accidental) / (coincident + accidental)
    own = globals_of("coexistence")
    assert own["fidelity"]("o-band", 18.7) == pytest.approx((1 + visible) / 2, abs=1e-5)


def test_berlins_fibre_is_lit_as_the_line_beside_it_is_drawn() -> None:
    """What 18.7 dBm scatter is that of the lab of coexistence; and pairs are lost as they say."""
    own, text = globals_of("city-fibre"), catalogue.lab("city-fibre").runs["60-km"].split()
    given = dict(each.removeprefix("q1-bob.").split("=") for each in text if "q1-bob." in each)
    power, lost, raman, _filter, middle, _window = own["CLASSICAL"]
    assert float(given["classical_mw"]) == power == pytest.approx(10**1.87, rel=1e-3)
    assert float(given["classical_db_per_km"]) == lost
    assert float(given["filter_center_nm"]) == middle
    o_band, _nm = globals_of("coexistence")["BANDS"]["o-band"]
    assert float(given["raman_per_km_nm"]) == raman == pytest.approx(o_band, rel=1e-4)
    assert float(given["loss_db_per_km"]) == pytest.approx(own["FIBER_DB"] / own["KM"])
    assert float(given["connectors_db"]) == pytest.approx(own["TOTAL_DB"] - own["FIBER_DB"])


def test_scattered_light_costs_as_much_fidelity_as_its_share_of_the_clicks() -> None:
    """At 60 km clicks of one pair are V or random as at New York; one by noise is random."""
    own = globals_of("city-fibre")
    mean = 2 * own["light"](2e5) / 0.68
    pairs = mean * 0.9 * 10 ** (-(3.01 + 60 * 0.425) / 10)
    power, lost, raman, width, _nm, window = own["CLASSICAL"]
    q, c = 0.425 * 0.2302585, lost * 0.2302585
    km = (exp(-q * 60) - exp(-c * 60)) / (c - q)
    photon_j = 6.62607015e-34 * 299_792_458 / 1324e-9
    noise = 0.9 * 10**-0.301 * power * 1e-3 * km * raman * width * window / photon_j
    others = exp(-mean * 0.68)
    of_pair, of_noise = pairs * (1 - 0.32 * others), noise * (1 - others)
    visible = own["visibility"](own["light"](2e5)) * of_pair / (of_pair + of_noise)
    assert own["beside"](60.0) == pytest.approx((1 + 3 * visible) / 4, abs=2e-4)


@pytest.mark.parametrize(
    ("kind", "decay", "end"), [("dephasing", 2, 7 / 15), ("depolarizing", 4 / 3, 1 / 4)]
)
def test_memories_of_sequence_keep_as_much_as_ours_are_given(
    kind: str, decay: float, end: float
) -> None:
    """Of a Werner pair of 0.9: what both waits together leave, in coherence times."""
    own = globals_of("memories")
    for waits in (0, 0.05, 0.4, 1.3, 3.0):
        expected = end + (0.9 - end) * exp(-decay * waits)
        assert own["fidelity"](kind, waits) == pytest.approx(expected, abs=6e-4)
    name, time_s = own["OURS"][kind]
    assert own["T_S"] / time_s == pytest.approx(decay)
    assert f"alice.memory.{name}={time_s:g} " in own["command_for"](kind, 1000)
