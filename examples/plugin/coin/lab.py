"""A lab: the share of coins that agree, beside 1 - misread."""

from collections.abc import Sequence

from coin.physics import MISREAD
from evidence.curves.estimates import proportion
from evidence.labs.lab import Finding, Lab, Published, Runs

RUN = "run coin --count 4000 --captures none --without report"
WEAR = {"new": 0.0, "worn": MISREAD}


def findings(runs: Runs) -> Sequence[Finding]:
    found = []
    for name, misread in WEAR.items():
        figures = runs[name].job.asking
        theory = Published(1 - misread, 0.0, "an outcome is flipped or not")
        found.append(
            Finding("", f"coins alike, {name}", proportion(figures.agreed, figures.coins), theory)
        )
    return found


LAB = Lab(
    title="coins by detectors that wear out",
    paper="closed form: 1 - misread",
    runs={"new": RUN, "worn": f"{RUN} --node bob=worn"},
    findings=findings,
    theirs="closed form",
)
