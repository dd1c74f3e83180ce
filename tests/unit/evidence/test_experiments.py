"""Experiments of `qmn lab curves` in small, against the closed form that each is drawn beside.

The experiments name the sources of those forms; test_small_curves.py and test_sweep_theory.py hold
them against others. Bounds are five standard errors (Estimate.agrees).
"""

from math import isnan

import pytest

from evidence.curves.catalogue import EXPERIMENTS, measure
from evidence.curves.estimates import Estimate
from evidence.curves.parameters import Values

SEED = 3
# At most of these points every parameter matters.
POINTS: list[tuple[str, Values]] = [
    ("sdc", {"depolarizing": 0.1, "connectors_db": 1.0, "fec": "hamming", "interleave": "on"}),
    ("sdc", {"depolarizing": 0.05, "connectors_db": 3.0, "rate_hz": 1_000_000}),
    ("teleport", {"fidelity": 0.7}),
    ("swap", {"first_fidelity": 0.9, "second_fidelity": 0.6}),
    ("eavesdropping", {"fraction": 0.4, "fidelity": 0.9}),
    ("hom", {"delay_ps": 0.7, "visibility": 0.8, "bandwidth_rad_per_s": 2e12}),
    ("hom", {"delay_ps": 0.2, "bandwidth_nm": 1.0, "dispersion_ps_per_nm": 2.0}),
    ("dead-time", {"efficiency": 0.3, "dead_time_s": 5e-8}),
    ("gated-bell", {"one_qubit_depolarizing": 0.1, "two_qubit_depolarizing": 0.2}),
    (
        "gated-swap",
        {
            "one_qubit_depolarizing": 0.02,
            "two_qubit_depolarizing": 0.1,
            "two_qubit_s": 0.01,
            "readout_s": 0.02,
            "readout_error": 0.03,
        },
    ),
    ("purification", {"fidelity": 0.8, "two_qubit_depolarizing": 0.05, "readout_error": 0.02}),
    ("nested", {"fidelity": 0.85, "levels": 1, "rounds": 2}),
    ("memory", {"t1_s": 1.0, "t2_s": 0.5, "rate_hz": 100_000, "stored": 1}),
    ("memory", {"t1_s": 0.5, "t2_s": 0.2, "rate_hz": 100_000, "stored": 0}),
    ("fresh-outcomes", {"uses": 3}),
    ("weak-pulses", {"mean_photons": 0.3, "loss_db": 2.0}),
    ("light-sources", {"source": "single-g2-0.02", "length_km": 10.0, "pairs": 200_000}),
    ("light-sources", {"source": "heralded", "pairs": 1_000_000}),
    ("light-sources", {"source": "single", "efficiency_mismatch": 0.4}),
    ("decoy-states", {"length_km": 2.0, "mean_photons": 0.6, "pairs": 500_000}),
    ("photon-splitting", {"eve": "on", "decoys": "on", "loss_db": 3.0}),
    ("photon-splitting", {"eve": "off", "decoys": "off", "loss_db": 3.0}),
    ("polarization", {"length_km": 4.0, "polarization_drift_rad_per_sqrt_km": 0.2}),
    ("compensation", {"every_s": 0.05, "measuring_s": 0.01}),
    ("compensation", {"every_s": 0.02, "length_km": 16.0}),
    (
        "compensation",
        {
            "every_s": 0.004,
            "polarization_drift_rad_per_sqrt_km": 5.0,
            "polarization_drift_time_s": 0.625,
        },
    ),
    ("polarization-modes", {"length_km": 4.0, "pdl_db": 3.0}),
    ("polarization-modes", {"pmd_ps_per_sqrt_km": 2.0, "bandwidth_nm": 2.0, "length_km": 4.0}),
    ("timing", {"jitter_ps": 300.0, "gate_s": 5e-10, "length_km": 1.0, "bandwidth_nm": 1.0}),
    ("delay-line", {"difference_km": 10.0, "delay_line_db_per_km": 0.3}),
    ("seal", {"tapped": 0.5, "depolarizing": 0.05, "fraction": 0.5}),
]
FEWER: Values = {"pairs": 50_000, "alarms": 400}


@pytest.mark.parametrize(("name", "given"), POINTS)
def test_an_experiment_measures_what_its_theory_says(name: str, given: Values) -> None:
    experiment = EXPERIMENTS[name]
    known = experiment.complete({})
    few = {each: number for each, number in FEWER.items() if each in known}
    values = experiment.complete({**few, **given})
    found = measure(name, values, SEED)
    assert found.keys() == {each.name for each in experiment.measures}
    compared = 0
    for each in experiment.measures:
        theory = each.theory(values)
        report = Estimate(*found[each.name])
        if theory is not None and not isnan(report.value):
            assert report.agrees(theory), (each.name, report, theory)
            assert report.error < (theory / 2 or 1e-3), f"{each.name} says nothing: {report}"
            compared += 1
    assert compared
