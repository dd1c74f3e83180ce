"""`qmn sweep --emulate` from outside: a network for each point, and what they measure."""

import csv
import subprocess
import sys
from math import exp
from pathlib import Path

from conftest import ROOT

FIBERS_PASSED = 6
COMMAND = [sys.executable, "-m", "qmn", "sweep", "sdc", "--emulate", "--message-bytes", "4096"]


def sweep(out: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    command = [*COMMAND, "--out", str(out), *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=110
    )


def test_a_network_for_each_point_measures_what_theory_says(tmp_path: Path) -> None:
    first = sweep(tmp_path, "--depolarizing", "0.002")
    assert first.returncode == 0, first.stderr
    again = sweep(tmp_path, "--depolarizing", "0.002,0")
    assert again.returncode == 0, again.stderr
    assert "2 points, seed 1; 1 are in" in again.stdout
    with (tmp_path / "sdc-emulated.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["depolarizing"] for line in lines] == ["0.002", "0.0"]
    for line in lines:
        p = 1 - (1 - float(line["depolarizing"])) ** FIBERS_PASSED
        distance = abs(float(line["dibit_error"]) - 3 * p / 4)
        assert distance <= 5 * float(line["dibit_error_standard_error"])
        assert float(line["arrived"]) == 1
    assert len(list((tmp_path / "runs").glob("*-sdc"))) == len(lines)
    assert (tmp_path / "sdc-emulated-dibit_error.png").stat().st_size > 10_000


def test_fidelity_falls_with_the_measured_latency_of_the_two_bits_as_theory_says(
    tmp_path: Path,
) -> None:
    t1_s, t2_s, states = 0.5, 0.2, 16_384
    words = ("--classical-mbps", "0.2,20", "--memory-t1-s", str(t1_s), "--memory-t2-s", str(t2_s))
    command = [*COMMAND[:4], "teleport", "--emulate", *words, "--out", str(tmp_path)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=110
    )
    assert done.returncode == 0, done.stderr
    assert "further from theory" not in done.stdout
    with (tmp_path / "teleport-emulated.csv").open() as file:
        slow, fast = csv.DictReader(file)
    for line in (slow, fast):
        waited_s, found = float(line["measured_wait_s"]), float(line["teleported"])
        fidelity = 1 / 2 + (2 * exp(-waited_s / t2_s) + exp(-waited_s / t1_s)) / 6
        assert abs(found - fidelity) <= 5 * float(line["teleported_standard_error"])
        assert waited_s > 2 * states / (1e6 * float(line["classical_mbps"]))
    assert float(slow["measured_wait_s"]) > float(fast["measured_wait_s"])
    assert float(slow["teleported"]) < float(fast["teleported"])
    assert (tmp_path / "teleport-emulated-teleported.png").stat().st_size > 10_000


def test_a_long_way_to_the_controller_takes_set_up_time(tmp_path: Path) -> None:
    """The controller asks the quantum switch for paths, and waits for its answer."""
    words = ("--control-km", "0,1000", "--time-scale", "20")
    done = sweep(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "sdc-emulated.csv").open() as file:
        near, far = csv.DictReader(file)
    round_trip_s = 2 * 1000e3 / 2.04e8
    assert float(far["path_setup_s"]) >= round_trip_s
    assert float(near["path_setup_s"]) < round_trip_s  # software of 200 ms here would be as long
    assert (tmp_path / "sdc-emulated-path_setup_s.png").stat().st_size > 10_000


def test_a_network_of_one_s_own_is_swept_between_hosts_of_any_names(tmp_path: Path) -> None:
    """The trunk of the example loses .2 dB, and one half of each pair passes it twice.

    The other half waits for it in a delay line, which loses .2 dB/km, too.
    """
    place = ("--topology", f"{ROOT}/examples/my_net.py:MyNet", "--from", "h1", "--to", "h2")
    done = sweep(tmp_path, *place)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "sdc-emulated.csv").open() as file:
        (line,) = csv.DictReader(file)
    assert (line["from"], line["arrived_theory"], line["dibit_error"]) == ("h1", "", "0.0")
    longer_km = 2 * 1.0 + 2 * 0.01  # than the other way: over the trunk twice, and to h1 and back
    lost_db = 2 * 0.2 + 0.2 * longer_km
    distance = abs(float(line["arrived"]) - 10 ** (-lost_db / 10))
    assert distance <= 5 * float(line["arrived_standard_error"])
