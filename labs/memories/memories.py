"""Pairs that wait in the memories of both ends, beside SeQUeNCe (after arXiv:2504.01290)."""

import json
from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from evidence.curves.estimates import Estimate
from evidence.labs.lab import Chart, Finding, Lab, Published, Run, Runs

REFERENCE = json.loads(Path(__file__).with_name("sequence_memories.json").read_text())
T_S = 2.0  # coherence time of SeQUeNCe's memories: after t e^(-2t/T) is left, or e^(-4t/3T)
OURS = {"dephasing": ("t2_s", T_S / 2), "depolarizing": ("depolarizing_s", 3 * T_S / 4)}
COPPER_KM = (1000, 5000, 15_000)  # a cable: outcomes cross two of them
CONFIDENCE_95 = 1.959964  # standard errors


def command_for(kind: str, copper_km: int) -> str:
    """Return the words behind `qmn`: all pairs come in one block."""
    name, time_s = OURS[kind]
    parts = [f"--device {host}.memory.{name}={time_s:g}" for host in ("alice", "bob")]
    return (
        "run distribute --purification none --count 8000 --sample 0.5"
        f" --copper-km {copper_km} --device charlie.source.fidelity={REFERENCE['fidelity']}"
        f" {' '.join(parts)} --captures none --without report,record"
    )


def fidelity(kind: str, waits: float) -> float:
    """Return that of SeQUeNCe after both waits together, in coherence times, between its steps."""
    return float(
        np.interp(waits, np.arange(len(REFERENCE[kind])) * 2 * REFERENCE["step"], REFERENCE[kind])
    )


def waited_s(run: Run) -> float:
    return sum(run.times_s("recall")) - sum(run.times_s("arrive"))


def findings(runs: Runs) -> Sequence[Finding]:
    """Return the fidelity of pairs that have waited, beside SeQUeNCe's."""
    rows = []
    for kind, copper_km in product(OURS, COPPER_KM):
        run = runs[f"{kind}-{copper_km}-km"]
        report, waits = run.job.asking, waited_s(run) / T_S
        error = (report.fidelity_high - report.fidelity_low) / 2 / CONFIDENCE_95
        theirs = Published(fidelity(kind, waits), 0.0, REFERENCE["program"])
        label = f"F, {kind}, copper of {copper_km} km"
        rows.append(Finding(kind, label, Estimate(report.fidelity, error), theirs, waits))
    return rows


LAB = Lab(
    title="pairs that wait in memories, as SeQUeNCe has them",
    paper="Chung et al., Cross-Validating Quantum Network Simulators (2025), arXiv:2504.01290",
    runs={f"{kind}-{km}-km": command_for(kind, km) for kind, km in product(OURS, COPPER_KM)},
    findings=findings,
    theirs="SeQUeNCe",
    charts=[
        Chart(
            kind,
            f"{kind}, beside the line of SeQUeNCe",
            "both waits (T)",
            "F",
            partial(fidelity, kind),
        )
        for kind in OURS
    ],
)
