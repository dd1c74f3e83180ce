"""Entanglement requests on GARR, static and dynamic, with signalling (arXiv:2605.28795)."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from qmn.labs.lab import Chart, Finding, Lab, Runs, paired
from qmn.sweeps.estimates import mean_of_draws
from qmn.sweeps.experiment import Measure
from qmn.sweeps.figure import Picture, Point, draw
from qmn.sweeps.parameters import Parameter

HERE = Path(__file__).parent
TOLD = json.loads((HERE / "reference.json").read_text())
KINDS = [(4, "edf"), (16, "edf"), (64, "edf"), (1, "timetable")]
WHAT = {"share": "packets made of those released", "turnaround": "s from release to completion"}
AXIS, OURS = "packets/s of each application", "the controller, in counted time"


def ours(runs: Runs, what: str, *case: object) -> list[float]:
    """Return by draw what was measured of a case of counted.py."""
    return [each[what] for each in runs["counted"].result[" ".join(map(str, case))]]


def findings(runs: Runs) -> Sequence[Finding]:
    """Return what comes without signalling, beside theirs."""
    found = []
    for (rate, order), (what, words) in product(KINDS, WHAT.items()):
        our = ours(runs, what, "made", "tree", rate, order, 0)
        their = TOLD[f"tree {rate} {order}"][what]
        finding = paired(f"{words}, {order}, {rate}/s", our, their, "their program")
        found.append(replace(finding, chart=what if order == "edf" else "", at=rate))
    times = ours(runs, "turnaround", "made", "garr", 16, "edf", 0)  # light goes round others'
    return [*found, Finding("", "the same of edf, 16/s, on all ways", mean_of_draws(times))]


def files(runs: Runs, folder: Path) -> Sequence[Path]:
    """Draw what orders and signalling do."""
    series = []
    for order, times in (("edf", 0), ("edf", 1), ("edf", 10), ("fcfs", 1), ("slots", 1)):
        shares: list[Point] = []
        for rate, _order in KINDS[:3]:
            told = ours(runs, "share", "released", "tree", rate, order, times)
            shares.append(({"x": rate}, mean_of_draws(told)))
        series.append((f"{order}, messages {times} times as long as fibres", shares))
    measure = Measure("orders", WHAT["share"], lambda _values: None)
    picture = Picture("orders and signalling", Parameter("x", 0.0), AXIS, measure, series)
    draw(picture, folder / "orders.png")
    return [folder / "orders.png"]


LAB = Lab(
    title="entanglement requests on GARR, static and dynamic, with signalling",
    paper="Tran et al., Dynamic Entanglement Packet Scheduling (2026), arXiv:2605.28795",
    runs={"counted": f"script {shlex.quote(str(HERE))}/counted.py"},
    findings=findings,
    charts=[
        Chart(what, "edf, no signalling", AXIS, words, ours=OURS, theirs="their program")
        for what, words in WHAT.items()
    ],
    files=files,
)
