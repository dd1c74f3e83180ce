"""Purification by noisy gates and readings, beside SeQUeNCe (after arXiv:2504.01290)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qmn.labs.lab import Chart, Finding, Lab, Published, Runs
from qmn.sweeps.estimates import Estimate, proportion

FIGURES = json.loads(Path(__file__).with_name("figures.json").read_text())
PAIRS = 20_000
CONFIDENCE_95 = 1.959964  # standard errors
RUN = f"run distribute --purification bbpssw --rounds 1 --count {PAIRS} --sample 0.5"


def said(figure: dict[str, Any]) -> str:
    """Return what is said behind `qmn` for a point."""
    parts = [f"charlie.source.fidelity={figure['fidelity']}"]
    for host in ("alice", "bob"):
        parts.append(f"{host}.gates.two_qubit_depolarizing={1 - figure['gate']:g}")
        parts.append(f"{host}.gates.readout_error={1 - figure['readout']:g}")
    devices = " ".join(f"--device {part}" for part in parts)
    return f"{RUN} {devices} --captures none --no-report --no-record"


def findings(runs: Runs) -> Sequence[Finding]:
    """Return fidelity and success of one round; readings of the estimate are corrected for."""
    found = []
    for figure in FIGURES["figures"]:
        told = runs[figure["name"]].result["asking"]
        kept = (2 * figure["readout"] - 1) ** 2  # of each correlation, by two readings
        width = told["fidelity_high"] - told["fidelity_low"]
        estimate = 1 / 4 + (told["fidelity"] - 1 / 4) / kept
        fidelity = Estimate(estimate, width / 2 / CONFIDENCE_95 / kept)
        success = proportion(told["survived"], told["compared"])
        words = "F {fidelity:g}, gates {gate:g}, readings {readout:g}".format(**figure)
        for chart, ours, theirs in (
            ("fidelity", fidelity, figure["purified"]),
            ("success", success, figure["success"]),
        ):
            published = Published(theirs, 0.0, FIGURES["program"])
            found.append(Finding(chart, f"{chart}: {words}", ours, published, theirs))
    return found


LAB = Lab(
    title="purification by noisy gates and readings, as SeQUeNCe has it",
    paper="Chung et al., Cross-Validating Quantum Network Simulators (2025), arXiv:2504.01290",
    runs={figure["name"]: said(figure) for figure in FIGURES["figures"]},
    findings=findings,
    charts=(
        Chart("fidelity", "one round of BBPSSW", "F, by SeQUeNCe", "F, in the network", float),
        Chart("success", "one round of BBPSSW", "success, by SeQUeNCe", "in the network", float),
    ),
)
