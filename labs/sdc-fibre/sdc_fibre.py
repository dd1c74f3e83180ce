"""Superdense coding over fibre: bits a pair (arXiv:1609.00713)."""

import shlex
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np

from evidence.curves import theory
from evidence.curves.estimates import information
from evidence.labs.lab import Chart, Finding, Lab, Published, PublishedRow, Runs, exactly

LEAF = shlex.quote(str(Path(__file__).with_name("leaf.png")))
SEND = f"run sdc --file {LEAF} --frame-bytes 1 --captures none --without report"
# Of Werner pairs; that of the preset fiber-2017 is what makes 1.665 bits.
FIDELITIES = {"perfect": 1.0, "fibre": 1 - 0.75 * theory.EXPERIMENT_P, "worse": 0.9, "worst": 0.85}
CAPACITY = Published(*theory.EXPERIMENT_BITS, "abstract")
PAPER = "arXiv:1609.00713"


def findings(runs: Runs) -> Sequence[Finding]:
    """Return bits a pair: 2 - H of how often a dibit has come in each of the four ways."""
    rows = []
    for name, fidelity in FIDELITIES.items():
        symbols = np.array(runs[name].job.asked.confusion)
        sent, received = np.indices(symbols.shape)
        ways = np.zeros(4, np.int64)
        np.add.at(ways, sent ^ received, symbols)
        bits = information([int(count) for count in ways])
        published = CAPACITY if name == "fibre" else None
        rows.append(Finding("capacity", "bits a pair", bits, published, at=fidelity))
    whole = runs["fibre"].result["delivered"]
    return [*rows, exactly("images that came", int(whole), 1, "abstract: image transfer")]


def capacity(fidelity: float) -> float:
    """Return 2 - H of a Werner pair of this fidelity."""
    return theory.capacity(theory.of_fidelity(fidelity))


LAB = Lab(
    title="superdense coding over fibre, 1.665 bits a pair",
    paper=f"Williams, Sadlier, Humble, Phys. Rev. Lett. 118, 050501 (2017), {PAPER}",
    runs={
        name: f"{SEND} --preset fiber-2017"
        if name == "fibre"
        else f"{SEND} --device charlie.source.fidelity={fidelity}"
        for name, fidelity in FIDELITIES.items()
    },
    findings=findings,
    rows=[
        PublishedRow(
            PAPER,
            f"bits a pair of superdense coding (p = {theory.EXPERIMENT_P:g} is fitted to them)",
            CAPACITY,
            itemgetter("capacity"),
            [("sdc", {"depolarizing": theory.EXPERIMENT_P})],
        )
    ],
    charts=(
        Chart(
            "capacity",
            "superdense coding of a picture",
            "fidelity of the pairs",
            "capacity (bits a pair)",
            capacity,
        ),
    ),
)
