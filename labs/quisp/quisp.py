"""Purification and swapping by noisy gates and readings, beside QuISP (after arXiv:2504.01290)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs

REFERENCE = json.loads(Path(__file__).with_name("figures.json").read_text())
CONFIDENCE_95 = 1.959964  # standard errors
PAIRS = "--count 20000 --sample 0.5 --captures none --without report,record"
# By what is compared: the run, and what says which sources make the pairs, and what is noisy.
TASKS = {
    "purified": (
        f"run distribute --purification bbpssw --rounds 1 {PAIRS}",
        ["--device charlie"],
        ["--device alice", "--device bob"],
    ),
    "swapped": (
        f"run swap --topology chain,3 --purification none {PAIRS} --switch q2.analysers=1 "
        "--switch q2.analyser.kind=gates",
        ["--device alice", "--device bob"],
        ["--switch q2"],
    ),
}


def tasks(figure: dict[str, Any]) -> Sequence[str]:
    return ["swapped"] if "swapped" in figure else ["purified"]


def command_for(figure: dict[str, Any], task: str) -> str:
    """Return the words behind `qmn` for a point."""
    run, sources, noisy = TASKS[task]
    parts = [f"{source}.source.fidelity={figure['fidelity']}" for source in sources]
    for part in noisy:
        parts.append(f"{part}.gates.two_qubit_depolarizing={1 - figure['gate']:g}")
        parts.append(f"{part}.gates.readout_error={1 - figure['readout']:g}")
    return " ".join([run, *parts])


def findings(runs: Runs) -> Sequence[Finding]:
    """Return fidelities, and success of one round; readings of the estimate are corrected for."""
    rows = []
    for figure, task in POINTS:
        asking = runs[f"{figure['name']}-{task}"].job.asking
        contrast = (
            (2 * figure["readout"] - 1) ** 2 if task == "purified" else 1.0
        )  # by two readings
        width = asking.fidelity_high - asking.fidelity_low
        estimate = 1 / 4 + (asking.fidelity - 1 / 4) / contrast
        ours = {task: Estimate(estimate, width / 2 / CONFIDENCE_95 / contrast)}
        if task == "purified":
            ours["success"] = proportion(asking.survived, asking.compared)
        label = "F {fidelity:g}, gates {gate:g}, readings {readout:g}".format(**figure)
        for what, our in ours.items():
            name = f"{what}: {label}"
            value, error = figure[what]
            their = Published(value, error, REFERENCE["program"])
            rows.append(Finding(what, name, our, their, value, error))
    return rows


POINTS = [(figure, task) for figure in REFERENCE["figures"] for task in tasks(figure)]
LAB = Lab(
    title="purification and swapping by noisy gates and readings, as QuISP has it",
    paper="Chung et al., Cross-Validating Quantum Network Simulators (2025), arXiv:2504.01290",
    runs={f"{figure['name']}-{task}": command_for(figure, task) for figure, task in POINTS},
    findings=findings,
    theirs="QuISP",
    charts=(  # without lines: the residuals below one would know no errors of QuISP
        Chart("purified", "one round", "F, by QuISP", "F", theirs="QuISP"),
        Chart("success", "one round", "success, by QuISP", "success", theirs="QuISP"),
        Chart("swapped", "two links swapped", "F, by QuISP", "F", theirs="QuISP"),
    ),
)
