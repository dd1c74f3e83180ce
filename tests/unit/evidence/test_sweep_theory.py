"""The closed forms give the numbers that the literature gives."""

import itertools
import math

import pytest

from evidence.curves import theory
from evidence.curves.catalogue import EXPERIMENTS, measure
from evidence.curves.coding_theory import residual_error
from evidence.curves.estimates import Estimate
from evidence.curves.parameters import Values

SEED = 3


def test_the_capacity_at_the_experiments_p_is_the_experiments() -> None:
    assert theory.capacity(theory.EXPERIMENT_P) == pytest.approx(1.665, abs=5e-4)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(
    ("p", "code", "consecutive", "interleaved"),
    [
        (0.05, "none", 2.5e-2, 2.5e-2),
        (0.05, "repetition", 1.313e-2, 1.844e-3),
        (0.05, "hamming", 2.008e-2, 5.230e-3),
        (0.05, "golay", 3.665e-3, 7.271e-4),
        (0.1, "repetition", 2.75e-2, 7.25e-3),
        (0.1, "hamming", 4.252e-2, 1.943e-2),
        (0.1, "golay", 1.699e-2, 8.018e-3),
    ],
)
def test_the_table_of_codes(p: float, code: str, consecutive: float, interleaved: float) -> None:
    assert residual_error(code, False, p) == pytest.approx(consecutive, rel=5e-4)
    assert residual_error(code, True, p) == pytest.approx(interleaved, rel=5e-4)


def test_a_code_that_is_not_perfect_has_no_theory() -> None:
    assert residual_error("reed-solomon", True, 0.05) is None


def test_swapping_is_not_the_product_of_fidelities() -> None:
    assert theory.swapped_fidelity(0.9, 0.8) == pytest.approx(0.9 * 0.8 + 0.1 * 0.2 / 3)
    assert theory.swapped_fidelity(0.25, 1.0) == 0.25


def test_a_perfect_pair_breaks_bells_inequality_and_noise_does_not() -> None:
    assert theory.chsh(1.0) == pytest.approx(2 * 2**0.5)
    assert theory.chsh(0.25) == 0


def test_depolarising_and_dephasing_convolve_as_paulis_do() -> None:
    likely = theory.pauli_probabilities(0.2, 0.1)
    assert sum(likely) == pytest.approx(1)
    assert likely == pytest.approx((0.85 * 0.9 + 0.05 * 0.1, 0.05, 0.85 * 0.1 + 0.05 * 0.9, 0.05))
    assert 2 - theory.entropy(theory.pauli_probabilities(0.1, 0)) == theory.capacity(0.1)


@pytest.mark.parametrize(
    "given",
    [
        {"depolarizing": 0.1, "dephasing": 0.05, "source_fidelity": 0.9},
        {"analyser_visibility": 0.8},
        {"preset": "fiber-2017"},
        {"loss_db_per_km": 0.2, "length_km": 10.0, "detectors_efficiency": 0.7},
        {"burst_depolarizing": 0.5, "connectors_db": 3.0},
        {"depolarizing": 0.05, "fec": "hamming", "interleave": "on"},
    ],
)
def test_the_physical_layer_agrees_with_every_theory_of_superdense_coding(given: Values) -> None:
    sdc = EXPERIMENTS["sdc"]
    values = sdc.complete({**given, "pairs": 100_000})
    measured = measure("sdc", values, SEED)
    known = {each.name: each.theory(values) for each in sdc.measures}
    assert any(value is not None for value in known.values())
    for name, value in known.items():
        assert value is None or Estimate(*measured[name]).agrees(value), name


@pytest.mark.parametrize(
    ("statistics", "mean", "arrives", "figure"),
    [("poisson", 0.1, 1.0, 0.0125), ("poisson", 0.5, 0.1, 0.1556), ("thermal", 0.1, 1.0, 0.0238)],
)
def test_several_pairs_give_the_error_rate_of_an_enumeration(
    statistics: str, mean: float, arrives: float, figure: float
) -> None:
    """Figures of tests/unit/dispatcher/test_further_pairs.py, which goes through all cases."""
    report = theory.several_pairs(statistics, mean, (arrives, arrives))
    assert report[0] == pytest.approx(figure, abs=6e-5)


@pytest.mark.parametrize(("mine", "yours"), [(0.68, 0.02), (0.1, 0.9)])
def test_halves_that_are_lost_unequally_err_as_all_numbers_of_pairs_say(
    mine: float, yours: float
) -> None:
    """Of n pairs k have bit 0; an end that sees both bits tells a coin."""

    def report(zeros: int, ones: int, arrives: float) -> tuple[float, float]:
        zero, one = (1 - (1 - arrives) ** count for count in (zeros, ones))
        return zero * (1 - one) + zero * one / 2, one * (1 - zero) + zero * one / 2

    mean, both, wrong = 0.3, 0.0, 0.0
    for pairs in range(25):
        for zeros in range(pairs + 1):
            chance = math.exp(-mean) * mean**pairs / math.factorial(pairs)
            chance *= math.comb(pairs, zeros) / 2**pairs
            hers, his = (report(zeros, pairs - zeros, each) for each in (mine, yours))
            both += chance * sum(hers) * sum(his)
            wrong += chance * (hers[0] * his[1] + hers[1] * his[0])
    found = theory.several_pairs("poisson", mean, (mine, yours))
    assert found == pytest.approx((wrong / both, both), rel=1e-9)


@pytest.mark.parametrize(
    ("dark", "error"), [(0.0, 0.1), (0.03, 0.0), (0.02, 0.05), ((0.0, 0.04), 0.05)]
)
def test_several_pairs_err_with_dark_counts_as_all_numbers_of_pairs_say(
    dark: float | tuple[float, float], error: float
) -> None:
    """Of each pair hers is 0 or 1, and his the same or not; four detectors may click by themselves.

    Up to ten pairs of .3 a pulse on average: of more there are 1e-13.
    """

    darks = dark if isinstance(dark, tuple) else (dark, dark)

    def report(zeros: int, ones: int, arrives: float, dark: float) -> tuple[float, float]:
        zero, one = (1 - (1 - dark) * (1 - arrives) ** count for count in (zeros, ones))
        return zero * (1 - one) + zero * one / 2, one * (1 - zero) + zero * one / 2

    mean, ways, both, wrong = 0.3, (0.3, 0.7), 0.0, 0.0
    for counts in itertools.product(range(11), repeat=4):
        if (pairs := sum(counts)) > 10:
            continue
        zeros, ones, zero_one, one_zero = counts  # hers and his
        chance = math.exp(-mean) * mean**pairs / 2**pairs
        chance *= (1 - error) ** (zeros + ones) * error ** (zero_one + one_zero)
        chance /= math.prod(map(math.factorial, counts))
        hers = report(zeros + zero_one, ones + one_zero, ways[0], darks[0])
        his = report(zeros + one_zero, ones + zero_one, ways[1], darks[1])
        both += chance * sum(hers) * sum(his)
        wrong += chance * (hers[0] * his[1] + hers[1] * his[0])
    found = theory.several_pairs("poisson", mean, ways, dark, error)
    assert found == pytest.approx((wrong / both, both), rel=1e-8)


@pytest.mark.parametrize("mean", [1e-4, 1e-3, 1e-2])
def test_weak_pulses_are_seen_and_wrong_as_the_paper_says_to_first_order(mean: float) -> None:
    """arXiv:1311.7129, section IV: D = 1 - (1 - 2 p) e^-m, e = p + e_mis (1 - e^-m)."""
    dark, error = 6e-7, 5e-3
    seen, wrong = theory.weak_pulse(mean, dark, error)
    assert seen == pytest.approx(1 - (1 - 2 * dark) * math.exp(-mean), rel=1e-3)
    assert wrong == pytest.approx(dark + error * (1 - math.exp(-mean)), rel=1e-2)


def test_a_key_of_decoys_is_below_that_of_photons_told_one_by_one() -> None:
    """Of Poisson pulses, exactly: yields of n photons are known, and bound the estimate closely."""
    means, shares, arrives = (0.5, 0.05, 0.0), (0.5, 0.35, 0.15), 0.01
    seen = [theory.weak_pulse(mean * arrives, 0.0, 0.0) for mean in means]
    ones = arrives * sum(p * m * math.exp(-m) for p, m in zip(shares, means, strict=True)) / 4
    assert 0.93 * ones < theory.decoy_key(means, shares, seen, 1.0) < ones


def test_two_pairs_within_one_attempt_come_one_behind_the_other() -> None:
    """p = 1/8: the first after 8 attempts, and of 8 gaps of 8 on average one is of one attempt."""
    assert theory.attempts_until_two(1 / 8, 1) == pytest.approx(72)
    assert theory.attempts_until_two(1 / 8, math.inf) == pytest.approx(16)
    assert theory.kept_over_gap(1 / 8, 1, 0.9) == pytest.approx(0.9)
    gaps = (1 / 8 * 0.9, 7 / 64 * 0.81)
    assert theory.kept_over_gap(1 / 8, 2, 0.9) == pytest.approx(sum(gaps) / (1 / 8 + 7 / 64))


def test_two_clicks_herald_half_of_the_pairs_of_which_both_photons_are_seen() -> None:
    """Barrett and Kok, Phys. Rev. A 71, 060310: P = eta^2 / 2, by enumeration of four outcomes."""
    eta, visibility = 0.4, 0.9
    seen = [eta * eta * apart for apart in (0, 1, 1, 0)]  # |00>, |01>, |10>, |11>: apart, or not
    assert theory.two_clicks(eta, visibility) == pytest.approx((sum(seen) / 4, 0.95))


@pytest.mark.parametrize(
    ("qber", "single", "share"),
    [
        (0.0, 0.7, 0.7),
        (0.11, 1.0, 0.000168),  # h(.11) = .499916
        (0.02, 0.9, 0.6201915),  # .9 (1 - h(.02/.9)) - h(.02)
        (0.05, 0.1, 0.0),  # each single photon may be wrong as often as right
        (0.9, 0.95, 0.0),  # and more often
        (0.0, 0.0, 0.0),
    ],
)
def test_keys_of_sources_that_send_several_photons_are_those_of_gllp(
    qber: float, single: float, share: float
) -> None:
    """Of a pulse seen in two (quant-ph/0212066): half of them are not seen."""
    assert theory.gllp(0.5, qber, single) == pytest.approx(share / 2, abs=1e-6)
