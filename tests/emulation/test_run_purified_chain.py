"""Nested purification in a chain of three repeaters, over the real components, beside its maps."""

from pathlib import Path

import pytest
from test_run_nodes import polarised, require_estimate, result_of

from qmn.sweeps.bell_diagonal import nested

FIDELITY = 0.92


@pytest.mark.parametrize("rounds", [0, 1])
def test_spans_are_purified_before_they_are_swapped(tmp_path: Path, rounds: int) -> None:
    words = ["swap", "--repeaters", "3", "--schedule", "nested", "--purify", str(rounds)]
    words += ["--purification", "none", "--count", "200", "--sample", "0.8"]
    for host in ("alice", "r1", "r2", "r3"):
        words += ["--device", f"{host}.source.fidelity={FIDELITY}"]
    asking = result_of(tmp_path, *words)["asking"]
    assert asking["pairs"] == 200
    require_estimate(asking, polarised(nested(FIDELITY, 2, rounds)), 0.0)
