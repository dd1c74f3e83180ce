"""Kraus operators over the real components: docs/noise-models/damping.py, as it says."""

from math import sqrt
from pathlib import Path

import pytest
from test_run_nodes import polarised, require_estimate, result_of

GAMMA = 1 - sqrt(0.7)  # of a fibre: .3 of the two that each half passes
DAMPED, TWIRLED = 0.745, 0.7225  # both halves by .3: ((2 - g)^2 + g^2) / 4, and (1 - g / 2)^2
NOISE = ["--fiber", "noise=docs/noise-models/damping.py:Damping"]
NOISE += ["--fiber", f'noise_parameters={{"gamma": {GAMMA}}}']


@pytest.mark.nightly
def test_pairs_are_damped_as_the_example_says(tmp_path: Path) -> None:
    """And not as the twirl into Paulis, which has another fidelity."""
    words = ["distribute", "--backend", "dense", *NOISE, "--rate-hz", "10000000"]
    asking = result_of(tmp_path, *words, "--count", "8000", "--sample", "0.9")["job"]["asking"]
    require_estimate(asking, polarised(DAMPED), 0.0)
    right = (2 * DAMPED + 1) / 3
    error = 1.5 * sqrt(right * (1 - right) / asking["sampled"])
    assert asking["fidelity"] - 5 * error > TWIRLED
