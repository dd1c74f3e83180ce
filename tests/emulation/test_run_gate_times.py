"""A repeater whose gates take time and whose readings err, over the real components."""

from math import exp
from pathlib import Path

import pytest
from test_run_nodes import result_of

ERROR, GATE_S, T2_S = 0.05, 0.05, 0.5
SCALE = 5


def fidelity(wait_s: float) -> float:
    """Return that of perfect pairs whose ends wait, by two bits that may be read wrongly."""
    read, kept = 1 - 2 * ERROR, exp(-2 * wait_s / T2_S)
    return (1 + kept * read + kept * read**2 + read) / 4


@pytest.mark.nightly
def test_ends_decohere_while_a_repeater_swaps(tmp_path: Path) -> None:
    words = ["swap", "--count", "300", "--sample", "0.8", "--time", f"paced={SCALE}"]
    told = {
        "r1.analyser.kind": "gates",
        "r1.gates.two_qubit_s": GATE_S,
        "r1.gates.readout_error": ERROR,
        "alice.memory.t2_s": T2_S,
        "bob.memory.t2_s": T2_S,
    }
    for name, value in told.items():
        words += ["--device", f"{name}={value}"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert asking["sampled"] >= 1_000
    # Beside the gate, messages and programs: of the latter 50 ms here at most, in all.
    error = 1.5 * 0.5 / asking["sampled"] ** 0.5
    least, most = fidelity(GATE_S + 0.05), fidelity(GATE_S)
    assert least - 5 * error < asking["fidelity"] < most + 5 * error
