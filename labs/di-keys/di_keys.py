"""Keys certified by a Bell test: of atoms (Munich, 2022) and of ions (Oxford, 2022)."""

from collections.abc import Sequence
from math import sqrt
from operator import itemgetter

from evidence.curves import theory
from evidence.curves.device_independent import Rounds, one_basis_rate, random_basis_rate
from evidence.curves.estimates import Estimate, of_two, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, PublishedRow, Run, Runs

PAPER, OXFORD = "doi 10.1038/s41586-022-04891-y", "doi 10.1038/s41586-022-04941-5"
FIDELITY, FIDELITY_ERROR = 0.892, 0.023  # abstract: F >= .892(23)
THERE = {
    "s": Published(2.578, 0.075, "abstract: S"),
    "qber": Published(0.078, 0.009, "abstract: QBER"),
    "rate": Published(0.07, 0.005, "abstract: key"),
}
FIDELITIES = {"paper": FIDELITY, "less": 0.87, "more": 0.93, "perfect": 1.0}
KEYS = "run qkd --protocol e91 --count 200000 --bound asymptotic --captures none --without report"
KEY_ROUNDS = 1 / 4  # alice has four settings, bob two: two of these eight are for the key
ION_PAIRS = "source.bell_diagonal=[0.96,0.0072,0.0256,0.0072]"  # F; 1.44 % errors in Z
ION_F, ION_QBER = Published(0.960, 0.001, "Oxford"), Published(0.0144, 0.0002, "Oxford, figure 3")
ION_S = Published(2.677, 0.006, "Oxford, figure 3")
PROTOCOL = Rounds(1_500_000, 13 / 256, s=2.64, qber=0.018)  # what was expected of the ions
ION_KEY = Published(95_884, 75, "Oxford, table I")  # half a unit of its rate's last digit, 6.39 %


def error_rate(fidelity: float) -> float:
    return 2 * (1 - fidelity) / 3


def key(s: float, qber: float) -> float:
    """Return the key bits of an entanglement, by a random basis."""
    return KEY_ROUNDS * random_basis_rate(s, qber)


def rate(fidelity: float) -> float:
    return key(theory.chsh(fidelity), error_rate(fidelity))


X, LINES = "fidelity of the pairs", {"s": theory.chsh, "qber": error_rate, "rate": rate}
CHARTS = {
    "s": ("the CHSH test of E91", X, "S of the CHSH test"),
    "qber": ("errors of the sifted bits", X, "error rate"),
    "rate": ("keys of devices that nobody trusts", X, "key bits an entanglement"),
}


def unsure(chart: str) -> float:
    """Return what the paper's error of F makes of a figure."""
    least, most = (LINES[chart](FIDELITY + sign * FIDELITY_ERROR) for sign in (-1, 1))
    return abs(most - least) / 2


def estimates(run: Run) -> tuple[Estimate, Estimate]:
    """Return S and the error rate that alice has computed."""
    asking = run.job.asking
    sample = asking.disclosed_bits
    qber = proportion(round(asking.qber * sample), sample)
    return Estimate(asking.chsh, asking.chsh_error), qber


def findings(runs: Runs) -> Sequence[Finding]:
    """Return S, error rate and key by fidelity; then what pairs as those of the ions are."""
    lines = []
    for name, fidelity in FIDELITIES.items():
        s, qber = estimates(runs[name])
        ours = {"s": s, "qber": qber, "rate": of_two(key, s, qber)}
        for chart, each in ours.items():
            there = THERE[chart] if name == "paper" else None
            errors = (FIDELITY_ERROR, unsure(chart)) if there else (0.0, 0.0)
            lines.append(Finding(chart, CHARTS[chart][2], each, there, fidelity, *errors))
    pairs, s = runs["ions-z"].job.asking, estimates(runs["ions"])[0]
    in_z = pairs.states // 2
    qber = proportion(round((1 - pairs.equal_in_z) * in_z), in_z)
    f = Estimate(pairs.fidelity, pairs.fidelity_error)
    bits = Estimate(PROTOCOL.key_of(s.value, qber.value), 0.0)
    endless = of_two(one_basis_rate, s, qber)
    lines.append(Finding("", "ions: F", f, ION_F))
    lines.append(Finding("", "ions: error rate in Z", qber, ION_QBER))
    lines.append(Finding("", "ions: S", s, ION_S, inputs=2 * sqrt(2) * ION_F.error))
    lines.append(Finding("", "ions: key of 1.5 million pairs (bits)", bits, ION_KEY))
    return [*lines, Finding("", "ions: key bits a round for it, of endless keys", endless)]


def rows() -> list[PublishedRow]:
    """Return S and the error rate of E91 on the physical layer alone, and keys by formulas."""
    point, published = ("eavesdropping", {"fidelity": FIDELITY}), []
    for chart, of in (("s", "chsh"), ("qber", "qber")):
        what, there = f"{of}, pairs of fidelity {FIDELITY:g}", THERE[chart]
        published.append(PublishedRow(PAPER, what, there, itemgetter(of), [point], unsure(chart)))
    paper = [Estimate(THERE[of].value, THERE[of].error) for of in ("s", "qber")]
    what = "key of 1.5 million rounds (bits)"
    published.append(
        PublishedRow(PAPER, "key, by these", THERE["rate"], lambda: of_two(key, *paper))
    )
    return [
        *published,
        PublishedRow(OXFORD, what, ION_KEY, lambda: Estimate(PROTOCOL.key_bits(), 0.0)),
    ]


LAB = Lab(
    title="keys certified by a Bell test: S, error rate and key of atoms and of ions",
    paper=f"Zhang et al., Nature 607, 687 (2022), {PAPER} and"
    f" Nadlinger et al., Nature 607, 682 (2022), {OXFORD}",
    runs={
        name: f"{KEYS} --device charlie.source.fidelity={fidelity} --length-km 0.1"
        for name, fidelity in FIDELITIES.items()
    }
    | {
        "ions": f"{KEYS} --device charlie.{ION_PAIRS} --length-km 0.001",
        "ions-z": "run ghz --line alice,bob --count 200000 --length-km 0.001 --captures none"
        f" --without report --device alice.{ION_PAIRS}",
    },
    findings=findings,
    rows=rows(),
    charts=[Chart(of, *text, LINES[of]) for of, text in CHARTS.items()],
)
