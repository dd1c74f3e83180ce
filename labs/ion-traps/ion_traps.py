"""Two nodes, a teleported CZ, and Grover's search by it (Oxford, arXiv:2407.00835)."""

import shlex
from pathlib import Path

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs

CZ, GROVER = Published(0.86, 0.005, "abstract"), Published(0.71, 0.005, "abstract")
# A CZ by pairs of fidelity F, and nothing else amiss, has (4F + 1)/5.
PAIRS, FIDELITIES = "fidelity of the pairs", {"paper": (5 * CZ.value - 1) / 4, "better": 0.95}
HERE = shlex.quote(str(Path(__file__).parent))
RUN = f"netqasm {HERE} --captures none --without report,record --rounds 3"


def search(fidelity: float) -> float:
    """Return how often both CZ have no error, or the same: others flip what is found."""
    return fidelity**2 + (1 - fidelity) ** 2 / 3


def findings(runs: Runs) -> list[Finding]:
    """Return how often the marked state is found, and the fidelity by stabilisers of CZ |++>."""
    rows = []
    for name, at in FIDELITIES.items():
        blocks: list[list[int]] = [[] for _ in range(7)]  # four of the search, then CZ |++>
        for output in runs[name].job.outputs:
            for block, *bits in zip(blocks, output["alice"], output["bob"], strict=True):
                block += [2 * a + b for a, b in zip(*bits, strict=True)]
        grover = proportion(sum(blocks[n].count(n) for n in range(4)), 4 * len(blocks[0]))
        equal = sum(block.count(0) + block.count(3) for block in blocks[4:])
        # By chance half of them are equal, of three stabilisers: F is (3 equal - 1)/2.
        agree = proportion(equal, 3 * len(blocks[4]))
        cz = Estimate((6 * agree.value - 1) / 5, 6 * agree.error / 5)
        theirs, unsure = ((CZ, GROVER), 5 * CZ.error / 4) if name == "paper" else ((None,) * 2, 0.0)
        inputs = unsure * (2 * at - 2 * (1 - at) / 3)  # by the slope of `search`
        rows.append(Finding("cz", "fidelity of the CZ", cz, theirs[0], at, unsure))
        rows.append(Finding("grover", "states found", grover, theirs[1], at, unsure, inputs))
    return rows


LAB = Lab(
    "two nodes: a CZ teleported with 86 %, and Grover's search with 71 %",
    "Main et al., Nature (2025), doi 10.1038/s41586-024-08404-x, arXiv:2407.00835",
    {name: f"{RUN} --device charlie.source.fidelity={at:g}" for name, at in FIDELITIES.items()},
    findings,
    (
        Chart("cz", "a teleported CZ", PAIRS, "average fidelity", lambda f: (4 * f + 1) / 5),
        Chart("grover", "Grover's search for one state of four", PAIRS, "found", search),
    ),
)
