"""Keys certified by a Bell test: S and error rate of two atoms 400 m apart (Munich, 2022)."""

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter

from qmn.labs.lab import Chart, Finding, Lab, Published, PublishedRow, Run, Runs
from qmn.sweeps import theory
from qmn.sweeps.estimates import Estimate, proportion

PAPER = "doi 10.1038/s41586-022-04891-y"
FIDELITY, FIDELITY_ERROR = 0.892, 0.023  # abstract: F >= .892(23)
S = Published(2.578, 0.075, "abstract: S")
QBER = Published(0.078, 0.009, "abstract: QBER")
FIDELITIES = {"paper": FIDELITY, "less": 0.87, "more": 0.93, "perfect": 1.0}
KEYS = "run qkd --protocol e91 --count 200000 --bound asymptotic --captures none --no-report"


def findings(runs: Runs) -> Sequence[Finding]:
    """Return S and the error rate; their slopes in F say what the paper's error of F does."""
    found = []
    for name, fidelity in FIDELITIES.items():
        s, qber = told(runs[name])
        s_there, qber_there = (S, QBER) if name == "paper" else (None, None)
        unsure = FIDELITY_ERROR if name == "paper" else 0.0
        found.append(Finding("s", "S of the CHSH test", s, s_there, fidelity, unsure))
        found.append(Finding("qber", "error rate", qber, qber_there, fidelity, unsure))
    return [replace(each, inputs=each.at_error * SLOPES[each.chart]) for each in found]


def told(run: Run) -> tuple[Estimate, Estimate]:
    """Return S and the error rate that alice has computed."""
    asking = run.result["job"]["asking"]
    sample = asking["disclosed_bits"]
    qber = proportion(round(asking["qber"] * sample), sample)
    return Estimate(asking["chsh"], asking["chsh_error"]), qber


def error_rate(fidelity: float) -> float:
    """Return how often outcomes in equal bases differ, of a Werner pair."""
    return 2 * (1 - fidelity) / 3


LINES = {"s": theory.chsh, "qber": error_rate}
SLOPES = {name: abs(of(1.0) - of(0.0)) for name, of in LINES.items()}  # of straight lines


def rows() -> list[PublishedRow]:
    """Return S and the error rate of E91 on the physical layer alone."""
    point, found = ("spied-pairs", {"fidelity": FIDELITY}), []
    for chart, measure, theirs in (("s", "chsh", S), ("qber", "qber", QBER)):
        unsure = FIDELITY_ERROR * SLOPES[chart]
        what = f"{measure}, pairs of fidelity {FIDELITY:g}"
        found.append(PublishedRow(PAPER, what, theirs, itemgetter(measure), [point], unsure))
    return found


LAB = Lab(
    title="keys certified by a Bell test over 400 m: S = 2.578, error rate 7.8 %",
    paper=f"Zhang et al., Nature 607, 687 (2022), {PAPER}",
    runs={
        name: f"{KEYS} --device charlie.source.fidelity={fidelity} --length-km 0.1"
        for name, fidelity in FIDELITIES.items()
    },
    findings=findings,
    rows=rows(),
    charts=(
        Chart("s", "the CHSH test of E91", "fidelity of the pairs", "S", theory.chsh),
        Chart(
            "qber", "errors of the sifted bits", "fidelity of the pairs", "error rate", error_rate
        ),
    ),
)
