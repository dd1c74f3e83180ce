"""A demo from outside: a fibre that flaps while light passes."""

import csv
from pathlib import Path

import pytest
from loaded import run_qmn

SLOW_S = 150


@pytest.mark.nightly
@pytest.mark.timeout(2 * SLOW_S)
def test_a_fibre_that_flaps_costs_the_light_of_the_time_without_a_path(tmp_path: Path) -> None:
    """It goes down each two seconds, and each session has that of light: some cut meets light."""
    words = ["--period-s", "2", "--sessions", "2", "--pairs", "200000", "--out", str(tmp_path)]
    words += ["--controller-delay-s", "0.02"]
    done = run_qmn("lab", "sweep", "flapping", "--emulate", *words, timeout_s=SLOW_S)
    assert done.returncode == 0, done.stdout + done.stderr
    with (tmp_path / "flapping-emulated.csv").open() as file:
        (line,) = csv.DictReader(file)
    lost, dark = float(line["lost"]), float(line["dark_share"])
    assert lost > 0
    assert abs(lost - dark) < 5 * float(line["lost_standard_error"])
