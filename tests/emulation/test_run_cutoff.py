"""Pairs that the controller has dropped when they are too old, over the real components."""

from math import exp
from pathlib import Path

import pytest
from test_run_nodes import polarised, require_estimate, result_of

CUTOFF_S = T2_S = 0.1
POLICY = "".join(
    f"[device.{host}]\ncutoff_us = {CUTOFF_S * 1e6:.0f}\n" for host in ("alice", "bob")
)


def kept(longest_s: float) -> float:
    """Return the coherence of pairs that have waited at both ends, evenly up to this long."""
    rate = 2 / T2_S
    return (1 - exp(-rate * longest_s)) / (rate * longest_s)


@pytest.mark.nightly
@pytest.mark.waits
def test_a_cutoff_of_the_controllers_keeps_the_fidelity_up(tmp_path: Path) -> None:
    """Pairs come one by one for a third of a second; all of them would have F = .58."""
    policy = tmp_path / "cutoff.toml"
    policy.write_text(POLICY)
    words = ["distribute", "--count", "10", "--sample", "0.5", "--fidelity", "0.62"]
    words += ["--purification", "none", "--rate-hz", "1000", "--block-pairs", "400"]
    words += ["--time", "paced=10", "--policy", str(policy)]
    for host in ("alice", "bob"):
        words += ["--device", f"{host}.memory.t2_s={T2_S}"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert asking["pairs"] == 10
    assert asking["shared"] < asking["emitted"] / 2  # of 325 pairs, those of the last 100 ms
    require_estimate(asking, polarised((1 + kept(CUTOFF_S)) / 2), 0.0)
