"""How long heralded links take, beside SeQUeNCe, QuISP and p c / 2L (after arXiv:2504.01290)."""

import json
from pathlib import Path

from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs

HERE, PROGRAMS = Path(__file__), ("sequence", "quisp")
TABLE = {each: json.loads(HERE.with_name(f"{each}_links.json").read_text()) for each in PROGRAMS}
GIVEN = TABLE["quisp"]  # to SeQUeNCe, too
# Kilometres to the station and whose attempts; modes.
LINKS = {(km, program): modes for program in PROGRAMS for km, modes in ((1, 1), (10, 10), (25, 20))}
PARTS = "source.statistics=none emitter.scheme=two-click emitter.efficiency={emitted}"
RUN = (
    "run distribute --switch q1.parts=station --count 900 --sample 0.1 --captures none"
    " --without report,record --loss-db-per-km {db_per_km}"
    " --switch q1.detectors.efficiency={detected}"
)


def mean_s(km: float, program: str) -> tuple[float, float]:
    """Return how long a program waits before an attempt's round trip, and for a pair."""
    flight_s = km * 1e3 / 2.04e8
    light = GIVEN["emitted"] * GIVEN["detected"] * theory.transmission(GIVEN["db_per_km"] * km)
    rounds = 1 + light * (2 - light) / 2 + light**2 / 8  # the second where one has clicked
    before_s = {"sequence": (6 * rounds - 2) * flight_s, "quisp": GIVEN["late_s"]}[program]
    return before_s, (2 * flight_s + before_s) / theory.two_clicks(light, 1.0)[0]


def command_for(km: int, program: str) -> str:
    """Return the words behind `qmn` for a link, with the station in the switch halfway."""
    modes = LINKS[km, program]
    before = f"emitter.preparation_s={mean_s(km, program)[0]:.9g}"
    settings = f"{PARTS} emitter.modes={modes} {before}".split()
    parts = "".join(f" --device {host}.{word}" for host in ("alice", "bob") for word in settings)
    return (RUN + parts).format(**GIVEN) + f" --length-km {km}"


def measured(pairs: int, attempts: int, took_s: float) -> list[tuple[float, float]]:
    often, pair_s = proportion(pairs, attempts), took_s / pairs
    return [(often.value, often.error), (pair_s, pair_s * often.error / often.value)]


def findings(runs: Runs) -> list[Finding]:
    """Return what was measured of each link, of one qubit at either end."""
    rows = []
    for (km, program), modes in LINKS.items():
        run = runs[f"{km}-km-{program}"]
        took_s = run.times_s("herald")[-1] - run.times_s("attempt")[-1]
        asking, table = run.job.asking, TABLE[program]
        counted = measured(asking.emitted, asking.attempts, took_s * modes)
        ours = [Estimate(*each) for each in counted]
        theirs = [Published(*each, table["program"]) for each in measured(*table["links"][str(km)])]
        rows.append(Finding("", f"attempts that succeed, {km} km", ours[0], theirs[0]))
        rows.append(Finding(program, f"s a pair, {km} km", ours[1], theirs[1], km))
    return rows


def drawn(of: str) -> Chart:
    return Chart(of, of, "km", "s a pair", lambda km: mean_s(km, of)[1], logarithmic=True)


LAB = Lab(
    title="times of heralded links, beside SeQUeNCe's and QuISP's",
    paper="Chung et al., Cross-Validating Quantum Network Simulators (2025), arXiv:2504.01290",
    runs={f"{km}-km-{program}": command_for(km, program) for km, program in LINKS},
    findings=findings,
    charts=[drawn(program) for program in TABLE],
)
