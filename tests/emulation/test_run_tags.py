"""Time tags of hosts over a real network; the seed is 1."""

import json
import subprocess
from math import exp, sqrt
from pathlib import Path

import numpy as np
import pytest
from loaded import run_qmn

from applications.time_tags import words
from topologies.system.processes.programs import ROOT, python

parquet = pytest.importorskip("pyarrow.parquet")

PAIRS = [
    *("qkd", "--protocol", "bbm92", "--count", "20000", "--rate-hz", "20000000"),
    *("--block-pairs", "262144", "--device", "charlie.source.statistics=poisson"),
    *("--device", "charlie.source.mean_pairs=0.02", "--device", "charlie.source.fidelity=0.94"),
    *("--device", "bob.detectors.jitter_ps=200", "--device", "bob.detectors.efficiency=0.8"),
    *("--device", "bob.detectors.clock_offset_s=123456ns"),
]
KINDS = "", ".truth"
PATTERNS = np.array([[1, 4], [2, 8]], np.uint8)  # by basis and bit
TAGS, ERRORS = 400_000, 0.03
WIDTH = 1.5e10  # rad/s
SPEED_M_PER_S = 2.04e8


def analysed(*words: str) -> list[str]:
    done = subprocess.run(
        [python(), f"{ROOT}/examples/tags.py", *words], capture_output=True, text=True, check=True
    )
    return done.stdout.split()


def test_tags_of_two_hosts_have_their_offset_errors_and_rates(tmp_path: Path) -> None:
    """Both hosts have paths of one length; the errors are those of the sample that they compare."""
    tags = tmp_path / "tags"
    done = run_qmn("run", *PAIRS, "--tags", str(tags), "--runs", str(tmp_path / "runs"))
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "runs" / "latest" / "result.json").read_text())
    files = [str(tags / f"{host}.tags") for host in ("alice", "bob")]
    ahead_ns = float(analysed(*files)[4])
    assert abs(ahead_ns - 123_456) <= 0.125
    alice, bob = (
        {
            (block, slot): channel
            for block, slot, channel in zip(
                truth["block"], truth["slot"], read["channel"], strict=True
            )
        }
        for read, truth in (
            [parquet.read_table(tags / f"{host}{kind}.parquet").to_pydict() for kind in KINDS]
            for host in ("alice", "bob")
        )
    )
    asking = result["job"]["asking"]
    assert len(bob) == asking["raw_bits"]
    same = [at for at in alice.keys() & bob.keys() if alice[at] // 2 == bob[at] // 2]
    assert len(same) == asking["sifted_bits"]
    qber = sum(alice[at] != bob[at] for at in same) / len(same)
    assert abs(qber - asking["qber"]) < 5 * sqrt(qber * (1 - qber) / asking["disclosed_bits"])


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("length_m", [0.005, 0.001])
def test_tags_of_a_bell_analyser_have_the_dip_of_hong_ou_and_mandel(
    length_m: float, tmp_path: Path
) -> None:
    """Light passes alice's fibre twice; a message of zeros is of one Bell state."""
    (tmp_path / "zeros").write_bytes(bytes(2000))
    words = ["--file", str(tmp_path / "zeros"), "--frame-bytes", "100", "--runs", str(tmp_path)]
    words += ["--device", "bob.analyser.delay_line_km=0"]
    words += ["--device", f"bob.analyser.bandwidth_rad_per_s={WIDTH}"]
    words += ["--fiber", f"alice-q1.length_km={length_m / 1000}", "--tags", str(tmp_path / "tags")]
    run_qmn("run", "sdc", *words)  # whose frames the dip spoils
    wrong = float(analysed("dip", str(tmp_path / "tags" / "bob.tags"))[1])
    expected = (1 - exp(-((WIDTH * 2 * length_m / SPEED_M_PER_S) ** 2))) / 2
    pairs = parquet.read_metadata(tmp_path / "tags" / "bob.parquet").num_rows / 2
    assert abs(wrong - expected) < 5 * sqrt(expected * (1 - expected) / pairs)


def test_keys_are_distilled_of_tags_that_hosts_play(tmp_path: Path) -> None:
    """As docs/time-tags/played.py: slots of 50 ns, and bob is 123,456 ns, 987,648 units, ahead."""
    random = np.random.default_rng(1)
    units = np.sort(random.integers(0, TAGS * 800, TAGS))  # one in 100 ns
    bases, bits = random.integers(0, 2, (2, TAGS)), random.integers(0, 2, TAGS)
    wrong = np.where(bases[0] == bases[1], random.random(TAGS) < ERRORS, random.random(TAGS) < 0.5)
    (tmp_path / "tags").mkdir()
    for host, ahead, patterns in (
        ("alice", 0, PATTERNS[bases[0], bits]),
        ("bob", 987_648, PATTERNS[bases[1], bits ^ wrong]),
    ):
        (tmp_path / "tags" / f"{host}.tags").write_bytes(words.encode(units + ahead, patterns))
    topology = ("--topology", f"{ROOT}/docs/time-tags/played.py:Played", "--time", "stepped")
    command = ["qkd", "--protocol", "bbm92", *topology, "--count", "10000"]
    runs = tmp_path / "runs"
    done = run_qmn("run", *command, "--bound", "asymptotic", "--runs", str(runs), cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    asking = json.loads((runs / "latest" / "result.json").read_text())["job"]["asking"]
    error = sqrt(ERRORS * (1 - ERRORS) / asking["disclosed_bits"])
    assert abs(asking["qber"] - ERRORS) < 5 * error
    assert asking["key_bits"] > 0
    # A slot has one tag with m e^-m, m = 1/2; both ends have chosen its basis with 1/8.
    sifted = asking["photons"] * exp(-0.5) / 16
    assert abs(asking["sifted_bits"] - sifted) < 5 * sqrt(sifted)
