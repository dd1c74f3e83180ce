"""Purification and swapping by noisy gates and readings, beside QuISP (after arXiv:2504.01290)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs

TOLD = json.loads(Path(__file__).with_name("figures.json").read_text())
CONFIDENCE_95 = 1.959964  # standard errors
PAIRS = "--count 20000 --sample 0.5 --captures none --without report,record"
# By what is compared: the run, whose sources make the pairs, and whose gates and readings err.
TASKS = {
    "purified": (
        f"run distribute --purification bbpssw --rounds 1 {PAIRS}",
        ["charlie"],
        ["alice", "bob"],
    ),
    "swapped": (
        f"run swap --purification none {PAIRS} --device r1.analyser.kind=gates",
        ["alice", "r1"],
        ["r1"],
    ),
}


def task(figure: dict[str, Any]) -> str:
    return "swapped" if "swapped" in figure else "purified"


def said(figure: dict[str, Any]) -> str:
    """Return what is said behind `qmn` for a point."""
    run, sources, noisy = TASKS[task(figure)]
    parts = [f"{host}.source.fidelity={figure['fidelity']}" for host in sources]
    for host in noisy:
        parts.append(f"{host}.gates.two_qubit_depolarizing={1 - figure['gate']:g}")
        parts.append(f"{host}.gates.readout_error={1 - figure['readout']:g}")
    return run + "".join(f" --device {part}" for part in parts)


def findings(runs: Runs) -> Sequence[Finding]:
    """Return fidelities, and success of one round; readings of the estimate are corrected for."""
    found = []
    for figure in TOLD["figures"]:
        what, told = task(figure), runs[figure["name"]].job.asking
        kept = (2 * figure["readout"] - 1) ** 2 if what == "purified" else 1.0  # by two readings
        width = told.fidelity_high - told.fidelity_low
        estimate = 1 / 4 + (told.fidelity - 1 / 4) / kept
        ours = {what: Estimate(estimate, width / 2 / CONFIDENCE_95 / kept)}
        if what == "purified":
            ours["success"] = proportion(told.survived, told.compared)
        words = "F {fidelity:g}, gates {gate:g}, readings {readout:g}".format(**figure)
        for chart, our in ours.items():
            value, error = figure[chart]
            their = Published(value, error, TOLD["program"])
            found.append(Finding(chart, f"{chart}: {words}", our, their, value, error))
    return found


LAB = Lab(
    title="purification and swapping by noisy gates and readings, as QuISP has it",
    paper="Chung et al., Cross-Validating Quantum Network Simulators (2025), arXiv:2504.01290",
    runs={figure["name"]: said(figure) for figure in TOLD["figures"]},
    findings=findings,
    theirs="QuISP",
    charts=(  # without lines: the residuals below one would know no errors of QuISP
        Chart("purified", "one round", "F, by QuISP", "F", theirs="QuISP"),
        Chart("success", "one round", "success, by QuISP", "success", theirs="QuISP"),
        Chart("swapped", "two links swapped", "F, by QuISP", "F", theirs="QuISP"),
    ),
)
