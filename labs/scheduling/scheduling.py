"""Entanglement requests on GARR, static and dynamic, with signalling (arXiv:2605.28795)."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from evidence.curves.estimates import Estimate, mean_of_draws
from evidence.curves.figure import Mark
from evidence.curves.packets import of_emulated
from evidence.labs.drawing import Series, draw_several
from evidence.labs.lab import Chart, Finding, Lab, Runs, paired

HERE = Path(__file__).parent
REFERENCE = json.loads((HERE / "reference.json").read_text())
KINDS = [(4, "edf"), (16, "edf"), (64, "edf"), (1, "timetable")]
WHAT = {"share": "packets made of those released", "turnaround": "s from release to completion"}
AXIS, NAMES = "packets/s of each application", ("the controller, in counted time", "their program")
RUNS = json.loads((HERE / "runs.json").read_text().replace("{here}", shlex.quote(str(HERE))))
ORDERS, SIGNALLING = ("edf", "slots"), (0, 1)  # of those in networks: messages, as long as fibres


def ours(runs: Runs, what: str, *case: object) -> list[float]:
    return [each[what] for each in runs["counted"].result[" ".join(map(str, case))]]


def taken(runs: Runs, order: str, times: int) -> tuple[Estimate, Estimate]:
    return of_emulated(runs[f"{order}-{times}"].job.load.sessions)


def findings(runs: Runs) -> Sequence[Finding]:
    """Return what comes without signalling, beside theirs, and what packets meet in a network."""
    rows = []
    for (rate, order), (what, label) in product(KINDS, WHAT.items()):
        our = ours(runs, what, "made", "tree", rate, order, 0)
        their = REFERENCE[f"tree {rate} {order}"][what]
        finding = paired(f"{label}, {order}, {rate}/s", our, their, "their program")
        rows.append(replace(finding, chart=what if order == "edf" else "", at=rate))
    times = ours(runs, "turnaround", "made", "garr", 16, "edf", 0)  # light goes round others'
    rows.append(Finding("", "the same of edf, 16/s, on all ways", mean_of_draws(times)))
    for case in product(ORDERS, SIGNALLING):
        for each, what in zip(taken(runs, *case), WHAT.values(), strict=True):
            rows.append(Finding("", f"{what}, in a network, {case}", each))
    return rows


def files(runs: Runs, folder: Path) -> Sequence[Path]:
    """Draw what orders and signalling do, in counted time and in a network."""
    shares, took = dict[str, Series](), dict[str, Series]()
    for order, times in (("edf", 0), ("edf", 1), ("edf", 10), ("fcfs", 1), ("slots", 1)):
        reports = {
            at: ours(runs, "share", "released", "tree", at, order, times) for at, _ in KINDS[:3]
        }
        name = f"{order}, messages {times} times as long as fibres"
        shares[name] = [(at, mean_of_draws(each)) for at, each in reports.items()]
    for order in ORDERS:
        took[order] = [(times, taken(runs, order, times)[1]) for times in SIGNALLING]
    theirs = [
        Mark(0, REFERENCE["tree 4 edf"]["turnaround"][0], 0, "their program, 30 applications")
    ]
    axes = (AXIS, WHAT["share"]), ("messages, times as long as fibres", WHAT["turnaround"])
    orders = draw_several(folder / "orders.png", "orders and signalling", axes[0], shares)
    return [orders, draw_several(folder / "emulated.png", "in a network", axes[1], took, theirs)]


TITLE = "entanglement requests on GARR, static and dynamic, with signalling"
PAPER = "Tran et al., Dynamic Entanglement Packet Scheduling (2026), arXiv:2605.28795"
CHARTS = [Chart(w, "edf, no signalling", AXIS, y, None, False, *NAMES) for w, y in WHAT.items()]
LAB = Lab(TITLE, PAPER, RUNS, findings, CHARTS, files=files)
