"""Purification by noisy gates and readings, beside SeQUeNCe (after arXiv:2504.01290)."""

import json
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, PublishedRow, Runs

FIGURES = json.loads(Path(__file__).with_name("figures.json").read_text())
PAPER = "arXiv:2504.01290"
PAIRS = 20_000
NAMES = {"fidelity": "purified", "success": "success"}  # of our figures, in that file
CONFIDENCE_95 = 1.959964  # standard errors
RUN = f"run distribute --purification bbpssw --rounds 1 --count {PAIRS} --sample 0.5"


def command_for(figure: dict[str, Any]) -> str:
    """Return the words behind `qmn` for a point."""
    parts = [f"charlie.source.fidelity={figure['fidelity']}"]
    for host in ("alice", "bob"):
        parts.append(f"{host}.gates.two_qubit_depolarizing={1 - figure['gate']:g}")
        parts.append(f"{host}.gates.readout_error={1 - figure['readout']:g}")
    devices = " ".join(f"--device {part}" for part in parts)
    return f"{RUN} {devices} --captures none --without report,record"


def words(figure: dict[str, Any], what: str) -> str:
    return what + ": F {fidelity:g}, gates {gate:g}, readings {readout:g}".format(**figure)


def published(figure: dict[str, Any], what: str) -> Published:
    return Published(figure[NAMES[what]], 0.0, FIGURES["program"])


def row(figure: dict[str, Any], what: str) -> PublishedRow:
    """Return it for the physical layer alone."""
    like = {"two_qubit_depolarizing": 1 - figure["gate"], "readout_error": 1 - figure["readout"]}
    point = "purification", {"fidelity": figure["fidelity"], "pairs": 300_000, **like}
    return PublishedRow(
        f"after {PAPER}", words(figure, what), published(figure, what), itemgetter(what), [point]
    )


def findings(runs: Runs) -> Sequence[Finding]:
    """Return fidelity and success of one round; readings of the estimate are corrected for."""
    rows = []
    for figure in FIGURES["figures"]:
        report = runs[figure["name"]].job.asking
        contrast = (2 * figure["readout"] - 1) ** 2  # of each correlation, by two readings
        width = report.fidelity_high - report.fidelity_low
        estimate = 1 / 4 + (report.fidelity - 1 / 4) / contrast
        fidelity = Estimate(estimate, width / 2 / CONFIDENCE_95 / contrast)
        success = proportion(report.survived, report.compared)
        for chart, ours in (("fidelity", fidelity), ("success", success)):
            theirs = published(figure, chart)
            rows.append(Finding(chart, words(figure, chart), ours, theirs, theirs.value))
    return rows


LAB = Lab(
    title="purification by noisy gates and readings, as SeQUeNCe has it",
    paper=f"Chung et al., Cross-Validating Quantum Network Simulators (2025), {PAPER}",
    runs={figure["name"]: command_for(figure) for figure in FIGURES["figures"]},
    findings=findings,
    rows=[row(figure, what) for figure in FIGURES["figures"] for what in NAMES],
    charts=(
        Chart("fidelity", "one round of BBPSSW", "F, by SeQUeNCe", "F, in the network", float),
        Chart("success", "one round of BBPSSW", "success, by SeQUeNCe", "in the network", float),
    ),
)
