"""A switch that swaps by gates that take time and readings that err; the real components."""

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
def test_ends_decohere_while_a_switch_swaps(tmp_path: Path) -> None:
    words = ["swap", "--topology", "chain,1", "--count", "300", "--sample", "0.8"]
    words += ["--time", f"paced={SCALE}", "--device", f"*.memory.t2_s={T2_S}"]
    for part in ("analysers=1", "memories=2", "analyser.kind=gates"):
        words += ["--switch", part]
    words += ["--switch", f"gates.two_qubit_s={GATE_S}", "--switch", f"gates.readout_error={ERROR}"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert asking["sampled"] >= 1_000
    # Beside the gate, messages and programs: of the latter 50 ms here at most, in all.
    error = 1.5 * 0.5 / asking["sampled"] ** 0.5
    least, most = fidelity(GATE_S + 0.05), fidelity(GATE_S)
    assert least - 5 * error < asking["fidelity"] < most + 5 * error
