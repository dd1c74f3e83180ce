"""Rows of published figures, and the formulas of keys that some of them are made of."""

import json
from collections.abc import Iterator, Sequence
from math import exp, hypot
from operator import itemgetter

import pytest
from rich.console import Console

from evidence.curves import finite_keys, theory, vacuum_and_weak
from evidence.curves.catalogue import EXPERIMENTS, measure
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.grid import Grid, Row
from evidence.curves.parameters import Value, Values
from evidence.labs import catalogue
from evidence.labs.lab import Published, PublishedRow
from evidence.labs.outcome import show
from evidence.labs.rows import measured, rows

SEQUENCE = json.loads((catalogue.LABS / "cross-check" / "figures.json").read_text())["figures"]


def test_the_difference_counts_errors_of_all_three() -> None:
    """2.578(75) of a fidelity that is known to .0867 in S, beside 2.42(2): 1.36 errors below."""
    row = PublishedRow(
        "doi 1", "S", Published(2.578, 0.075, "abstract"), itemgetter("s"), (), 0.0867
    )
    finding = row.finding([{"s": Estimate(2.42, 0.02)}])
    assert finding.difference == pytest.approx((2.42 - 2.578) / hypot(0.02, 0.0867, 0.075))
    assert finding.published is not None
    assert finding.published.source == "doi 1: abstract"


def test_points_of_several_rows_are_measured_once() -> None:
    def ratio(one: Outcome, other: Outcome) -> Estimate:
        return Estimate(one["chsh"].value / other["chsh"].value, 0.1)

    good, bad = ("chsh", {"fidelity": 1}), ("chsh", {"fidelity": 0.5})
    both = [
        PublishedRow("arXiv:1", "ratio", Published(3.0, 0.0, "table"), ratio, [good, bad]),
        PublishedRow("arXiv:1", "S", Published(2.8, 0.1, "table"), itemgetter("chsh"), [good]),
    ]
    asked: list[Value] = []

    def measurer(_grid: Grid, points: Sequence[Values], _seed: int) -> Iterator[Row]:
        for values in points:
            asked.append(values["fidelity"])
            yield values, {"chsh": Estimate(theory.chsh(float(values["fidelity"])), 0.1)}

    *_, findings = measured(both, 1, measurer)
    assert asked == [1.0, 0.5]
    assert [each.ours.value for each in findings] == pytest.approx([3.0, 2 * 2**0.5])


def test_every_row_names_its_paper_and_where_it_says_so() -> None:
    for row in rows():
        assert "arXiv:" in row.paper or row.paper.startswith("doi ")
        assert row.published.source
        assert row.published.error > 0 or row.published.source.startswith("sequence ")


@pytest.mark.parametrize("figure", SEQUENCE, ids=itemgetter("name"))
def test_a_round_of_purification_is_that_of_sequence(figure: dict[str, float]) -> None:
    """To the last digit of what SeQUeNCe 0.8.5 prints."""
    report = theory.purified(figure["fidelity"], 1 - figure["gate"], 1 - figure["readout"])
    assert report == pytest.approx((figure["purified"], figure["success"]), rel=1e-12)


def test_hosts_purify_on_the_physical_layer_as_theory_says() -> None:
    given: Values = {"fidelity": 0.8, "two_qubit_depolarizing": 0.04, "readout_error": 0.02}
    experiment = EXPERIMENTS["purification"]
    estimates = measure("purification", experiment.complete(given), 3)
    assert Estimate(*estimates["fidelity"]).agrees(0.7997553136)  # SeQUeNCe 0.8.5
    assert Estimate(*estimates["success"]).agrees(0.7283798528)


@pytest.mark.parametrize(("length_km", "weak"), [(0.0, 0.1), (40.0, 0.12), (130.0, 0.05)])
def test_bounds_by_vacuum_and_weak_are_the_papers(length_km: float, weak: float) -> None:
    """Ma, Qi, Zhao and Lo 2005, equations 34 and 37, with Y0 known from the vacuum."""
    mean, dark = 0.48, 1.7e-6
    light = 0.045 * 10 ** (-0.021 * length_km)
    (signal, decoy), errors = (
        [dark + 1 - exp(-light * each) for each in (mean, weak)],
        dark / 2 + 0.033 * (1 - exp(-light * weak)),
    )
    share = weak**2 / mean**2
    one = decoy * exp(weak) - signal * exp(mean) * share - (1 - share) * dark
    one *= mean / (mean * weak - weak**2)
    wrong = (errors * exp(weak) - dark / 2) / (one * weak)
    assert vacuum_and_weak.with_decoys(length_km, weak) == pytest.approx((one, wrong), rel=1e-6)


@pytest.mark.nightly
def test_at_100_km_a_hundred_times_longer_blocks_bring_1_75_times_the_key() -> None:
    """Section IV: "the secret key rate obtained with n_X = 10^9 is about 1.75 times" 10^7's."""
    ratio = finite_keys.best_rate(1e9, 100.0) / finite_keys.best_rate(1e7, 100.0)
    assert ratio == pytest.approx(1.75, abs=0.05)


def test_blocks_of_ten_thousand_bits_reach_beyond_120_km() -> None:
    """Section IV says 135 km; its formulas and channel as printed end at 127 by our search."""
    assert 1e-8 < finite_keys.best_rate(1e4, 120.0) < 1e-6
    assert finite_keys.best_rate(1e4, 150.0) == 0.0


@pytest.mark.nightly
def test_what_is_known_to_differ_is_told_with_its_reason_and_no_fault() -> None:
    """arXiv:1311.7129 states 135 km; the reach of its printed formulas was searched, by 0.5 km."""
    (finding,) = (
        row.finding([]) for row in rows() if row.what == "km to which keys go, n_X = 10^4 bits"
    )
    assert finding.published is not None
    assert finding.published.value == 135
    assert abs(finding.ours.value - 127) < 0.5
    assert finding.difference is not None
    assert finding.difference < -5
    assert finding.agrees(5)
    console = Console(width=300, record=True)
    show(console, [finding], 5)
    text = console.export_text()
    assert "KNOWN" in text
    assert "with eps_sec of 1e-10 a bit" in text
