"""`qmn lab sweep --emulate` from outside: a network for each point, and what they measure."""

import csv
import subprocess
import sys
from math import exp, sqrt
from pathlib import Path

import pytest
from conftest import ROOT, wait_until
from distributed import LocalCluster
from limits import PROGRAM_S

from evidence.curves.cluster import HTTP_ADDRESS

FIBERS_PASSED = 6
TWO_POINTS = ("--depolarizing", "0.001,0.002")
SWEEP = ["qmn", "lab", "sweep", "sdc", "--emulate", "--message", "abcdefgh" * 512]
SWEEP += ["--frame-bytes", "32"]
COMMAND = [sys.executable, "-m", *SWEEP]


def sweep(out: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    command = [*COMMAND, "--out", str(out), *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PROGRAM_S
    )


def begin(run: Path) -> float:
    """Return when a program of the network printed its only word, ready."""
    return (run / "fork-server.log").stat().st_mtime


def end(run: Path) -> float:
    """Return when the network had ended, and its result was written."""
    return (run / "result.json").stat().st_mtime


@pytest.fixture(scope="module")
def two_points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sweep two points beside each other, and return where."""
    folder = tmp_path_factory.mktemp("two")
    done = sweep(folder, *TWO_POINTS, "--workers", "2")
    assert done.returncode == 0, done.stderr
    return folder


def lines(folder: Path) -> list[dict[str, str]]:
    """Return what the table says of each point."""
    (table,) = folder.glob("*.csv")
    with table.open() as file:
        return sorted(csv.DictReader(file), key=lambda line: float(line["depolarizing"]))


def require_theory(folder: Path, *points: str) -> None:
    """Fail unless each point has the errors of its depolarising, and there is a figure."""
    assert [line["depolarizing"] for line in lines(folder)] == list(points)
    for line in lines(folder):
        p = 1 - (1 - float(line["depolarizing"])) ** FIBERS_PASSED
        distance = abs(float(line["symbol_error_rate"]) - 3 * p / 4)
        assert distance <= 5 * float(line["symbol_error_rate_standard_error"])
        assert float(line["arrived"]) == 1
    (figure,) = folder.glob("sdc-*-symbol_error_rate.png")
    assert figure.stat().st_size > 10_000


@pytest.mark.nightly
def test_points_that_are_in_the_table_are_not_measured_again(two_points: Path) -> None:
    again = sweep(two_points, *TWO_POINTS)
    assert "2 points, seed 1; 2 are in" in again.stdout
    require_theory(two_points, "0.001", "0.002")


@pytest.mark.nightly
def test_networks_run_beside_each_other(two_points: Path) -> None:
    runs = list((two_points / "runs").glob("*-sdc*"))
    assert len(runs) == 2
    assert max(begin(run) for run in runs) < min(end(run) for run in runs)


@pytest.mark.nightly
def test_a_cluster_measures_the_same_as_this_machine(two_points: Path, tmp_path: Path) -> None:
    """Its workers are threads of this process; each starts networks apart from it, too."""
    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address=HTTP_ADDRESS,
        scheduler_kwargs={"dashboard": False},
        local_directory=tmp_path / "dask",
    ) as there:
        done = sweep(tmp_path, *TWO_POINTS, "--scheduler", there.scheduler_address)
    assert done.returncode == 0, done.stderr
    for mine, theirs in zip(lines(two_points), lines(tmp_path), strict=True):
        assert mine == theirs


def test_nothing_is_left_of_networks_whose_sweep_is_killed(tmp_path: Path) -> None:
    command = [*COMMAND, "--out", str(tmp_path), "--depolarizing", "0:0.002:9", "--workers", "2"]
    runs = tmp_path / "runs"
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL) as process:
        wait_until(lambda: len([*runs.glob("*/dispatcher.log")]) >= 2, "two networks")
        process.kill()
    # That no program of theirs is left, nor starts another, is what each test here is held to.


@pytest.mark.nightly
def test_fidelity_falls_with_the_measured_latency_of_the_two_bits_as_theory_says(
    tmp_path: Path,
) -> None:
    t1_s, t2_s, states = 0.5, 0.2, 16_384
    words = ["--copper-mbps", "0.2,20", "--count", str(states), "--block-pairs", str(states)]
    words += [f"--node.memory.t1_s={t1_s}", f"--node.memory.t2_s={t2_s}"]
    command = [*COMMAND[:5], "teleport", "--emulate", *words, "--out", str(tmp_path)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PROGRAM_S
    )
    assert done.returncode == 0, done.stderr
    assert "further from theory" not in done.stdout
    (table,) = tmp_path.glob("teleport-copper_mbps-*.csv")
    with table.open() as file:
        slow, fast = sorted(csv.DictReader(file), key=lambda row: float(row["copper_mbps"]))
    for line in (slow, fast):
        waited_s, found = float(line["waiting_s"]), float(line["fidelity"])
        fidelity = 1 / 2 + (2 * exp(-waited_s / t2_s) + exp(-waited_s / t1_s)) / 6
        assert abs(found - fidelity) <= 5 * float(line["fidelity_standard_error"])
        assert waited_s > 2 * states / (1e6 * float(line["copper_mbps"]))
    assert float(slow["waiting_s"]) > float(fast["waiting_s"])
    assert float(slow["fidelity"]) < float(fast["fidelity"])
    assert float(line["fidelity_theory"]) == pytest.approx(fidelity)


@pytest.mark.nightly
def test_a_long_way_to_the_controller_takes_set_up_time(tmp_path: Path) -> None:
    """The controller asks the quantum switch for paths, and waits for its answer."""
    words = ("--control-km", "0,1000")
    done = sweep(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    (table,) = tmp_path.glob("*.csv")
    with table.open() as file:
        near, far = csv.DictReader(file)
    round_trip_s = 2 * 1000e3 / 2.04e8
    longer_s = float(far["setup_s"]) - float(near["setup_s"])
    assert longer_s == pytest.approx(round_trip_s, rel=1e-4)
    (figure,) = tmp_path.glob("sdc-*-setup_s.png")
    assert figure.stat().st_size > 10_000


@pytest.mark.nightly
def test_a_network_of_one_s_own_is_swept_between_hosts_of_any_names(tmp_path: Path) -> None:
    """The trunk of the example loses .2 dB, and one half of each pair passes it twice.

    The other half waits for it in a delay line, which loses .2 dB/km, too.
    """
    place = ("--topology", f"{ROOT}/examples/my_net.py:MyNet", "--from", "h1", "--to", "h2")
    done = sweep(tmp_path, *place)
    assert done.returncode == 0, done.stderr
    (table,) = tmp_path.glob("*.csv")
    with table.open() as file:
        (line,) = csv.DictReader(file)
    assert (line["from"], line["arrived_theory"], line["symbol_error_rate"]) == ("h1", "", "0.0")
    longer_km = 2 * 1.0 + 2 * 0.01  # than the other way: over the trunk twice, and to h1 and back
    lost_db = 2 * 0.2 + 0.2 * longer_km
    distance = abs(float(line["arrived"]) - 10 ** (-lost_db / 10))
    assert distance <= 5 * float(line["arrived_standard_error"])


def test_a_chain_of_switches_is_swept_against_the_life_of_all_memories(tmp_path: Path) -> None:
    """Pairs dephase by the sum of all their waits (docs/swapping.md), here some tenths of T2.

    Points that differ in the sample alone share a network.
    """
    words = ["--switches", "1:2", "--node.memory.t2_s", "2ms", "--length-km", "5km"]
    words += ["--count", "2000", "--sample", "0.3,0.5", "--out", str(tmp_path)]
    command = [*COMMAND[:5], "swap", *words]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PROGRAM_S
    )
    assert done.returncode == 0, done.stderr
    assert "further from theory" not in done.stdout
    assert len([*(tmp_path / "runs").glob("*-swap*")]) == 2
    (table,) = tmp_path.glob("*.csv")
    with table.open() as file:
        rows = [*csv.DictReader(file)]
    places = [(row["switches"], row["sample"]) for row in rows]
    assert places == [("1", "0.3"), ("1", "0.5"), ("2", "0.3"), ("2", "0.5")]
    for row in rows:
        fidelity = (1 + exp(-float(row["waiting_s"]) / 2e-3)) / 2
        assert 0.6 < fidelity < 0.95
        assert float(row["fidelity_theory"]) == pytest.approx(fidelity)
        distance = abs(float(row["fidelity"]) - fidelity)
        assert distance <= 5 * float(row["fidelity_standard_error"])


TURNED = """
from netqasm.sdk import Qubit
from netqasm.sdk.external import NetQASMConnection

def main(app_config=None, n=0):
    with NetQASMConnection("alice") as unit:
        qubit = Qubit(unit)
        qubit.rot_X(n=n, d=3)
        return {"one": qubit.measure()}
"""


def test_a_program_is_swept_over_its_input_and_finds_what_its_gate_says(tmp_path: Path) -> None:
    """Turned by n pi / 8 about X a qubit is found as 1 with sin(n pi / 16)^2."""
    (tmp_path / "app_alice.py").write_text(TURNED)
    words = ["netqasm", "--application", str(tmp_path), "--input", "alice.n=4,alice.n=8"]
    command = [*COMMAND[:5], *words, "--rounds", "50", "--out", str(tmp_path / "out")]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PROGRAM_S
    )
    assert done.returncode == 0, done.stderr
    (table,) = (tmp_path / "out").glob("*.csv")
    with table.open() as file:
        half, whole = csv.DictReader(file)
    assert abs(float(half["alice"]) - 0.5) < 5 * sqrt(0.25 / 50)
    assert float(half["alice_standard_error"]) == pytest.approx(sqrt(0.25 / 50), rel=0.3)
    assert (whole["alice"], whole["alice_standard_error"]) == ("1.0", "0.0")


@pytest.mark.nightly
def test_traffic_is_swept_with_its_own_figures(tmp_path: Path) -> None:
    """As many sessions come in a second as are asked for, by Poisson's law."""
    words = ["load", "--rate-per-s", "5,20", "--sessions", "100", "--out", str(tmp_path)]
    done = subprocess.run(
        [*COMMAND[:5], *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=PROGRAM_S,
    )
    assert done.returncode == 0, done.stderr
    (table,) = tmp_path.glob("*.csv")
    with table.open() as file:
        rows = [*csv.DictReader(file)]
    for row, rate in zip(rows, (5, 20), strict=True):
        assert abs(float(row["offered_per_s"]) / rate - 1) < 5 / sqrt(100)
        assert float(row["accepted"]) + float(row["blocked"]) <= 100
