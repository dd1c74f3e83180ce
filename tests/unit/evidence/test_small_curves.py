"""Curves of `make curves` in small, against closed forms that are written out here.

CHSH of Werner pairs is 2 sqrt 2 (4F - 1)/3 (Horodecki et al. 1995), Hong-Ou-Mandel coincidences of
Gaussian spectra are 1/2 (1 - V exp(-(sigma tau)^2)). Bounds are five standard errors of these.
"""

from itertools import product
from math import cos, exp, log2, log10, pi, prod, sqrt
from typing import Any

import numpy as np
import pytest

from evidence.curves import relay_theory, theory
from evidence.curves.catalogue import EXPERIMENTS, measure
from evidence.curves.estimates import Estimate
from evidence.curves.parameters import Value, Values
from evidence.curves.running import disagreements

SEED = 5
PAIRS = 20_000


def measured(experiment: str, name: str, **given: Value) -> float:
    """Return a measure of an experiment at a point."""
    return measure(experiment, complete(experiment, given), SEED)[name][0]


def complete(experiment: str, given: Values) -> Values:
    return EXPERIMENTS[experiment].complete({"pairs": PAIRS, **given})


@pytest.mark.parametrize(
    ("way", "gain", "qber"), [("along", 0.247455, 0.0661364), ("against", 0.25442, 0.0799725)]
)
def test_photons_beside_classical_light(way: str, gain: float, qber: float) -> None:
    """20 km of .33 and .2 dB/km, 1 mW: .037400 photons scattered along, .046699 against.

    By a sum over all numbers of photons in either detector, whose second click is a coin.
    """
    given: Values = {"classical_way": way, "pairs": 200_000}
    estimates = measure("classical-light", complete("classical-light", given), SEED)
    assert abs(estimates["gain"][0] - gain) < 5 * sqrt(gain * (1 - gain) / 200_000)
    assert abs(estimates["qber"][0] - qber) < 5 * sqrt(qber * (1 - qber) / (200_000 * gain))


def test_entangled_pairs_err_as_their_fibre_depolarises() -> None:
    """A click in c = 1 - (1 - .1) (1 - 6e-7)^2; (1 - .99 (.1 (1 - 6e-7) / c)^2)/2 of c^2 differ."""
    estimates = measure("pair-keys", complete("pair-keys", {"pairs": 6_000_000}), SEED)
    click = 1 - 0.9 * (1 - 6e-7) ** 2
    seen = 6_000_000 * click**2 / 2  # in bases that are alike
    qber = (1 - 0.99 * (0.1 * (1 - 6e-7) / click) ** 2) / 2
    assert abs(estimates["qber"][0] - qber) < 5 * sqrt(qber / seen)


def test_pairs_are_handed_over_as_their_sample_lets_expect() -> None:
    """(1 + 2 w e^-1 + w e^-.5 + (1 - e^-.25)^2)/4, w = (4 x .95 - 1)/3, and .95 at the sample."""
    estimates = measure("fidelity-age", complete("fidelity-age", {"waited_s": 0.05}), SEED)
    error = estimates["delivered"][1]
    assert abs(estimates["estimate"][0] - 0.95) < 5 * error
    right, of_each = (1 + 2.8 / 3) / 2, PAIRS / 2 / 3  # every other block, in each of three bases
    likely = sqrt(3 * right * (1 - right) / of_each) / 2
    assert estimates["estimate"][1] == pytest.approx(likely, rel=0.1)
    assert abs(estimates["expected"][0] - 0.5754337) < 5 * error
    assert abs(estimates["delivered"][0] - 0.5754337) < 5 * error


def test_pairs_are_made_for_those_that_are_wanted_and_the_sample() -> None:
    """Twelve and a sample of 30, 1.05 x 42 + 1 = 45.1: as are made where all of them come."""
    estimates = measure("overhead", EXPERIMENTS["overhead"].complete({"requests": 3}), SEED)
    assert estimates["made"] == (46 / 12, 0)


@pytest.mark.nightly
def test_what_is_enumerated_of_pairs_made_is_a_series_where_one_is_wanted() -> None:
    """3 + 12/2^3 + 48/2^15 + 192/2^63 + ...: four times as much each time that nothing comes."""
    given: Values = {"wanted": 1, "sample": 0.0, "loss_db": 10 * log10(2), "requests": 300}
    values, report = EXPERIMENTS["overhead"].complete(given), 3 + 12 / 8 + 48 / 2**15
    assert EXPERIMENTS["overhead"].measure("made").theory(values) == pytest.approx(report, abs=1e-6)
    found, error = measure("overhead", values, SEED)["made"]
    assert abs(found - report) < 5 * error


def test_a_memory_heralds_what_has_come_and_what_has_not() -> None:
    """Of a tenth that comes .8, and of the rest a hundredth: .089, of which .08 are photons."""
    given: Values = {"loss_db": 10.0, "herald_efficiency": 0.8, "false_herald": 0.01}
    estimates = measure("memory-heralds", complete("memory-heralds", given), SEED)
    assert abs(estimates["heralded"][0] - 0.089) < 5 * sqrt(0.089 / PAIRS)
    assert abs(estimates["there"][0] - 0.08 / 0.089) < 5 * sqrt(0.09 / (0.089 * PAIRS))


@pytest.mark.parametrize(("hosts", "p", "fidelity"), [(3, 0.1, 0.85625), (5, 0.3, 0.3810531)])
def test_ghz_states_over_links_that_depolarise(hosts: int, p: float, fidelity: float) -> None:
    """(.95^2 + .9^2)/2 and (.85^4 + .7^4)/2: half the mean of stabilisers of either kind."""
    estimates = measured("ghz", "fidelity", hosts=hosts, depolarizing=p)
    assert abs(estimates - fidelity) < 5 * sqrt(
        1.25 / (PAIRS / 2)
    )  # of a coherence, and half a share


@pytest.mark.parametrize(
    ("graph", "hosts", "p", "fidelity"),
    [
        ("line", 3, 0.1, 0.85625),  # (1 + 2 .9 + 5 .9^2)/8
        ("ring", 3, 0.1, 0.73655),  # (1 + .9^2 + 2 .9^3 + 4 .9^4)/8: one edge is of two links
        ("star", 4, 0.05, 0.7982103),  # (1 + k + k^2 + 2 k^3 + k^4 + k^5 + 9 k^6)/16, k = .95
    ],
)
def test_graph_states_over_links_that_depolarise(
    graph: str, hosts: int, p: float, fidelity: float
) -> None:
    estimates = measured("graph", "fidelity", graph=graph, hosts=hosts, depolarizing=p)
    assert abs(estimates - fidelity) < 5 / sqrt(PAIRS)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(
    ("hosts", "p", "qber", "key"),
    [(3, 0.05, 0.04875, 0.4379), (4, 0.02, 0.029404, 0.6172), (5, 0.1, 0.17195, 0.0)],
)
def test_conference_keys_over_links_that_depolarise(
    hosts: int, p: float, qber: float, key: float
) -> None:
    """Q = (1 - (1 - p)^(N - 1))/2 in X, and of the last host in Z; 1 - 2 h(Q) of each bit."""
    for name in ("qber_x", "qber_z"):
        estimates = measured("conference", name, hosts=hosts, depolarizing=p)
        assert abs(estimates - qber) < 5 * sqrt(qber * (1 - qber) / (PAIRS / 2))
    slope = 2 * abs(log2(qber / (1 - qber)))
    estimates = measured("conference", "key", hosts=hosts, depolarizing=p)
    assert abs(estimates - key) < 5 * slope * sqrt(qber / (PAIRS / 2)) + 1e-4


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize(("hosts", "km"), [(3, 0.0), (4, 20.0), (3, 80.0)])
def test_conference_keys_over_distance(hosts: int, km: float) -> None:
    """By a sum over which photons are lost: who misses one has seen the dark, and has any bit."""
    links, dark = hosts - 1, 1 - (1 - 1e-6) ** 2
    reads = 0.9 + 0.1 * dark  # rightly, but for 1e-6
    gain = alike = 0.0
    for lost in product((0, 1), repeat=links):
        chance = prod(1 - 10 ** (-0.02 * km) if each else 10 ** (-0.02 * km) for each in lost)
        chance *= reads**links * prod(dark if each else reads for each in lost)
        gain += chance
        alike += chance * (0.5 if any(lost) else (1 + 0.99**links) / 2)
    pairs, qber = 200_000, 1 - alike / gain
    given: Values = {"hosts": hosts, "length_km": km, "pairs": pairs}
    found = measure("conference-distance", complete("conference-distance", given), SEED)
    slack = 1e-5 * gain  # of bits by dark counts in place of a photon
    assert abs(found["gain"][0] - gain) < 5 * sqrt(gain / pairs) + slack
    for name in ("qber_x", "qber_z"):
        assert abs(found[name][0] - qber) < 5 * sqrt(qber / (gain * pairs / 2)) + slack
    experiment = EXPERIMENTS["conference-distance"]
    theories = [experiment.measure(name).theory for name in ("gain", "qber_z")]
    values = complete("conference-distance", given)
    for theory_of, expected in zip(theories, (gain, qber), strict=True):
        assert theory_of is not None
        assert theory_of(values) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("probes", "hosts", "p", "efficiency", "error"),
    [
        ("ghz", 4, 0.0, 1.0, 0.0176777),  # 1/(4 sqrt 200): Heisenberg's limit
        ("separate", 4, 0.0, 1.0, 0.0353553),  # 1/sqrt(4 200): the standard quantum limit
        ("ghz", 3, 0.1, 0.9, 0.0340812),  # 1/(3 .9^2 sqrt(200 .9^3))
        ("separate", 3, 0.1, 0.9, 0.0430331),  # 1/sqrt(3 200 .9)
    ],
)
def test_the_mean_phase_is_told_at_its_limit(
    probes: str, hosts: int, p: float, efficiency: float, error: float
) -> None:
    given: Values = {"probes": probes, "hosts": hosts, "estimates": 100}
    given |= {"depolarizing": p, "efficiency": efficiency}
    values = EXPERIMENTS["sensing"].complete(given)
    report, spread = measure("sensing", values, SEED)["mean_error"]
    assert spread == pytest.approx(report / sqrt(200))
    assert abs(report - error) < 5 * error / sqrt(200)


@pytest.mark.parametrize("protocol", ["bbm92", "e91"])
def test_pairs_are_seen_as_often_and_err_as_often_as_an_enumeration_has_it(protocol: str) -> None:
    """At 20 km each arm sees .1 10^(-.2) of the photons, or 6e-7 dark counts in either detector."""
    seen, dark, error = 0.1 * 10**-0.2, 6e-7, 0.005
    alike = differ = 0.0
    for his_photon, her_photon in ((1, 1), (1, 0), (0, 1), (0, 0)):
        ends = [seen if photon else 1 - seen for photon in (his_photon, her_photon)]
        for wrong in (0, 1):  # of the photons, if both are seen
            reports = [told_by(photon, dark) for photon in (his_photon, her_photon)]
            flip = wrong if his_photon and her_photon else 0
            share = ends[0] * ends[1] * (error if wrong else 1 - error)
            same = reports[0][0] * reports[1][0] + reports[0][1] * reports[1][1]
            other = reports[0][0] * reports[1][1] + reports[0][1] * reports[1][0]
            alike += share * (other if flip else same)
            differ += share * (same if flip else other)
    gain, pairs = alike + differ, 400_000
    values: dict[str, Value] = {"length_km": 20.0, "protocol": protocol, "pairs": pairs}
    told_gain = measured("pair-keys", "gain", **values)
    assert abs(told_gain - gain) < 5 * sqrt(gain / pairs)
    qber, sifted = differ / gain, gain * pairs * (0.4 if protocol == "e91" else 0.5)
    assert abs(measured("pair-keys", "qber", **values) - qber) < 5 * sqrt(qber / sifted)
    theory_of = {each.name: each.theory for each in EXPERIMENTS["pair-keys"].measures}
    given = EXPERIMENTS["pair-keys"].complete(values)
    assert theory_of["gain"](given) == pytest.approx(gain, rel=1e-9)
    assert theory_of["qber"](given) == pytest.approx(qber, rel=1e-9)
    single = theory.several_pairs("single", 1.0, (seen, seen), dark, error)
    assert single == pytest.approx((qber, gain), rel=1e-9)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(
    ("experiment", "given"),
    [
        ("multi-pair", {"statistics": "single", "dark_count": 0.02, "loss_db": 10.0}),
        ("multi-pair", {"statistics": "thermal", "dark_count": 0.02, "mean_pairs": 0.3}),
        ("pair-keys", {"statistics": "poisson", "mean_pairs": 0.3}),
        ("pair-keys", {"statistics": "thermal", "mean_pairs": 0.3, "length_km": 10.0}),
    ],
)
def test_dark_counts_and_several_pairs_err_as_the_closed_form_has_it(
    experiment: str, given: dict[str, Value]
) -> None:
    """tests/unit/evidence/test_sweep_theory.py holds that form against all numbers of pairs."""
    values = EXPERIMENTS[experiment].complete({**given, "pairs": 400_000})
    (qber,) = (each for each in EXPERIMENTS[experiment].measures if each.name == "qber")
    expected = qber.theory(values)
    assert expected is not None
    estimates = measure(experiment, values, SEED)
    assert Estimate(*estimates["qber"]).agrees(expected)
    assert estimates.keys() == {
        each.name for each in EXPERIMENTS[experiment].measures
    }  # for its table


def test_a_relay_tells_as_much_of_lasers_as_the_published_forms_say() -> None:
    """Lo, Curty and Qi's relay 40 km from either end; by a sum over phases and clicks.

    Ma and Razavi's formulas, as they are in relay_theory, have to give the same.
    """
    found = measure("mdi", complete("mdi", {"length_km": 40.0, "pairs": 100_000}), SEED)
    seen, signals = 0.4 * 0.9 * 10**-0.4, 0.5**2 * 100_000 / 4
    gain, wrong = relayed(seen, (1, 0), (0, 1), {"Psi+": 1, "Psi-": 1})
    formula = relay_theory.rectilinear(seen, seen, DARK, MISALIGNED)
    assert formula == pytest.approx((gain, wrong), rel=1e-9)
    assert gain == pytest.approx(2 * exp(-seen) * (1 - exp(-seen / 2)) ** 2, rel=1e-3)
    assert abs(found["gain"][0] - gain) < 5 * sqrt(gain / signals)
    qber = wrong / gain
    assert abs(found["qber"][0] - qber) < 5 * sqrt(qber / (gain * signals))
    half = sqrt(0.5)
    report, errs = relayed(seen, (half, half), (half, -half), {"Psi+": 0, "Psi-": 1})
    formula = relay_theory.diagonal(seen, seen, DARK, MISALIGNED)
    assert formula == pytest.approx((report, errs), rel=1e-9)
    qber = errs / report
    assert 0.24 < qber < 0.25  # a quarter by pairs of one end, and of the others few
    assert abs(found["qber_x"][0] - qber) < 5 * sqrt(qber / (report * signals))


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize("heralding", [0.0, 0.7])
@pytest.mark.parametrize("km", [0.0, 40.0])
def test_a_relay_tells_as_much_of_heralded_pairs_as_gaussian_states_say(
    heralding: float, km: float
) -> None:
    """Thermal light is a Gaussian state: no detector of a set clicks with 1/det(1 + e N).

    N is the coherency of its modes. Missed heralds are of thermal light, too; others are not.
    """
    share = 1 / (1 + 0.2 * heralding)
    parts = [(1.0, 0.2)]
    if heralding:
        parts += [(-share, 0.2 * (1 - heralding) * share), (share, 0.0)]
    half, seen, pairs = sqrt(0.5), 0.9 * 10 ** (-0.01 * km), 1_000_000
    bases = {
        "qber": ([(1.0, 0.0), (0.0, 1.0)], {"Psi+": 1, "Psi-": 1}),
        "qber_x": ([(half, half), (half, -half)], {"Psi+": 0, "Psi-": 1}),
    }
    values = complete(
        "mdi-pairs", {"length_km": km, "heralding_efficiency": heralding, "pairs": pairs}
    )
    found = measure("mdi-pairs", values, SEED)
    for name, (states, differ) in bases.items():
        right = wrong = 0.0
        for (state, ways), her, his in product(CLICKS.items(), (0, 1), (0, 1)):
            chance = sum(
                one * other * told_of_thermal(states[her], states[his], (a * seen, b * seen), way)
                for (one, a), (other, b) in product(parts, repeat=2)
                for way in ways
            )
            if (her != his) == bool(differ[state]):
                right += chance / 4
            else:
                wrong += chance / 4
        gain, errs = right + wrong, MISALIGNED * right + (1 - MISALIGNED) * wrong
        qber = errs / gain
        expected = EXPERIMENTS["mdi-pairs"].measure(name).theory
        assert expected is not None
        assert expected(values) == pytest.approx(qber, rel=1e-6)
        assert abs(found[name][0] - qber) < 5 * sqrt(qber / (gain * pairs / 4))
        if name == "qber":
            assert abs(found["gain"][0] - gain) < 5 * sqrt(gain / (pairs / 4))


def told_of_thermal(
    her: tuple[float, float], his: tuple[float, float], means: tuple[float, float], way: Any
) -> float:
    """Return how likely these two detectors click alone, of thermal light in these states."""
    modes = [
        np.sqrt(mean / 2) * np.array([h, v, sign * h, sign * v])
        for (h, v), mean, sign in zip((her, his), means, (1, -1), strict=True)
    ]
    coherency = np.outer(modes[0], modes[0]) + np.outer(modes[1], modes[1])
    others = [mode for mode in range(4) if mode not in way]
    found = 0.0
    for some in ((), way[:1], way[1:], way):
        silent = [*others, *some]
        lit = np.eye(len(silent)) + coherency[np.ix_(silent, silent)]
        found += (-1) ** len(some) * (1 - DARK) ** len(silent) / float(np.linalg.det(lit))
    return found


DARK, MISALIGNED, PHASES = 1e-6, 0.015, 48
# Which detectors alone have to click: c H, c V, d H, d V behind the beam splitter.
CLICKS = {"Psi+": ((0, 1), (2, 3)), "Psi-": ((0, 3), (2, 1))}


def relayed(
    seen: float, zero: tuple[float, float], one: tuple[float, float], differ: dict[str, int]
) -> tuple[float, float]:
    """Return how likely a state is heralded, and with bits that do not differ as they should there.

    Of pulses of `seen` photons in these amplitudes of H and V; MISALIGNED of the right are wrong,
    and of the wrong right. The phase between pulses is anything.
    """
    right = wrong = 0.0
    for (state, ways), her, his in product(CLICKS.items(), (0, 1), (0, 1)):
        for number in range(PHASES):
            turn = cos(2 * pi * number / PHASES)
            light = [
                seen * ((h * h + v * v) / 2 + sign * h * v * turn)
                for sign in (1, -1)
                for h, v in zip((zero, one)[her], (zero, one)[his], strict=True)
            ]
            silent = [(1 - DARK) * exp(-each) for each in light]
            chance = sum(
                prod(1 - silent[mode] if mode in way else silent[mode] for mode in range(4))
                for way in ways
            )
            if (her != his) == bool(differ[state]):
                right += chance / 4 / PHASES
            else:
                wrong += chance / 4 / PHASES
    return right + wrong, MISALIGNED * right + (1 - MISALIGNED) * wrong


def told_by(photon: int, dark: float) -> tuple[float, float]:
    """Return how likely an end tells the bit 0, and 1, where a photon that is seen is a 0."""
    if photon:  # the detector of 1 may click, too: a bit at random
        return 1 - dark / 2, dark / 2
    one = dark * (1 - dark) + dark**2 / 2
    return one, one


@pytest.mark.parametrize(
    ("fidelity", "s"),
    [(1.0, 2.828427), (0.9, 2.451304), (0.78, 1.998755), (0.5, 0.942809), (0.25, 0.0)],
)
def test_s_of_werner_pairs(fidelity: float, s: float) -> None:
    """Each of four correlations is +-S/4, of a quarter of the pairs; S has a sign."""
    sigma = sqrt(4 * (1 - (s / 4) ** 2) / (PAIRS / 4))
    assert abs(measured("chsh", "chsh", fidelity=fidelity) - s) < 5 * sigma
    assert theory.chsh(fidelity) == pytest.approx(s, abs=1e-6)


@pytest.mark.parametrize("s", [2.0, 2.3, -2.828427, 3.5])
def test_an_s_that_breaks_the_inequality_is_not_enough(s: float) -> None:
    """Perfect pairs must give 2.828, not just anything above 2."""
    values = complete("chsh", {"fidelity": 1.0})
    (text,) = disagreements(EXPERIMENTS["chsh"], [(values, {"chsh": Estimate(s, 0.01)})])
    assert text.startswith("chsh at ")
    assert text.endswith("theory 2.82843")
    near = {"chsh": Estimate(2.79, 0.01)}
    assert disagreements(EXPERIMENTS["chsh"], [(values, near)]) == []


@pytest.mark.parametrize(
    ("delay_ps", "visibility", "coincidences"),
    [
        (0.0, 1.0, 0.0),
        (0.5, 1.0, 0.110600),
        (-0.5, 1.0, 0.110600),
        (1.0, 1.0, 0.316060),
        (2.0, 1.0, 0.490842),
        (1.0, 0.7, 0.371242),
        (0.0, 0.7, 0.15),
    ],
)
def test_photons_that_come_apart_coincide(
    delay_ps: float, visibility: float, coincidences: float
) -> None:
    """At a bandwidth of 1e12 rad/s; without the square it would be 0.1967 at half a picosecond."""
    found = measured("hom", "coincidences", delay_ps=delay_ps, visibility=visibility)
    assert abs(found - coincidences) <= 5 * sqrt(coincidences * (1 - coincidences) / PAIRS)
    assert theory.coincidences(delay_ps * 1e-12, visibility, 1e12) == pytest.approx(
        coincidences, abs=1e-6
    )


@pytest.mark.parametrize(
    ("slots", "every"), [(0.0, 1), (0.5, 1), (1.0, 1), (1.5, 2), (2.0, 2), (2.5, 3), (3.0, 3)]
)
def test_a_dead_time_ends_within_a_slot_and_its_pulse_is_not_seen(slots: float, every: int) -> None:
    """One pulse in 10 ns, in a train that begins with one that is seen."""
    seen = measured("dead-time", "clicks", dead_time_s=slots * 1e-8, pairs=1_002)
    assert seen == pytest.approx(1 / every, abs=1e-12)


@pytest.mark.parametrize(
    ("scheme", "per_s", "fidelity"),
    [
        # Light of .1 behind 2 dB: .0630957. p c / 2L of 10 km: 10,200 attempts a second.
        ("two-click", 10_200 * 0.0630957**2 / 2, 0.95),
        # One of both emits with .18, so that .0113572 click; of both .01 x (2 x .0630957 - ...).
        ("single-click", 10_200 * (0.01135723 + 0.00125988 - 3.981e-5 + 3.782e-5), 0.8769),
    ],
)
def test_heralds_come_with_each_round_trip(scheme: str, per_s: float, fidelity: float) -> None:
    values = complete("heralding", {"scheme": scheme, "arm_km": 10.0})
    found = measure("heralding", values, SEED)
    assert abs(found["rate"][0] - per_s) < 5 * per_s / sqrt(PAIRS)
    assert abs(found["fidelity"][0] - fidelity) < 5 * sqrt(3 / 4 / (PAIRS / 3))
