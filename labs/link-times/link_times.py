"""How long heralded links take, beside SeQUeNCe and p c / 2L (after arXiv:2504.01290)."""

import json
from collections.abc import Sequence
from pathlib import Path

from qmn.labs.lab import Chart, Finding, Lab, Published, Runs
from qmn.sweeps import theory
from qmn.sweeps.estimates import Estimate, proportion

TOLD = json.loads(Path(__file__).with_name("links.json").read_text())
# Kilometres to the station and flights of an attempt (0: SeQUeNCe's), modes and time scale.
LINKS = {(1, 0): (1, 30), (10, 0): (10, 15), (25, 0): (20, 4), (10, 2): (10, 60)}
WHAT, CHARTS = ("attempts that succeed", "s a pair"), ("", "times")
PARTS = "source.statistics=none emitter.scheme=two-click emitter.efficiency={emitted}"
RUN = (
    "run distribute --node charlie=station --count 900 --sample 0.1 --captures none --no-report"
    " --no-record --loss-db-per-km {db_per_km} --device charlie.detectors.efficiency={detected}"
)


def mean_s(km: float, flights: float) -> tuple[float, float]:
    """Return the mean time of an attempt of so many flights (0: SeQUeNCe's), and of a pair."""
    light = TOLD["emitted"] * TOLD["detected"] * theory.transmission(TOLD["db_per_km"] * km)
    rounds = 1 + light * (2 - light) / 2 + light**2 / 8  # the second where one has clicked
    attempt_s = (flights or 6 * rounds) * km * 1e3 / 2.04e8
    return attempt_s, attempt_s / theory.two_clicks(light, 1.0)[0]


def said(km: int, flights: int) -> str:
    """Return what is said behind `qmn` for a link, whose light passes two fibres to the station."""
    modes, scale = LINKS[km, flights]
    before_s = mean_s(km, flights)[0] - mean_s(km, 2)[0]
    words = f"{PARTS} emitter.modes={modes} emitter.preparation_s={before_s:.9g}".split()
    parts = "".join(f" --device {host}.{word}" for host in ("alice", "bob") for word in words)
    return (RUN + parts).format(**TOLD) + f" --length-km {km / 2:g} --time-scale {scale}"


def measured(pairs: int, attempts: int, took_s: float) -> tuple[Estimate, Estimate]:
    """Return how often an attempt succeeds, and how long a pair takes."""
    often, pair_s = proportion(pairs, attempts), took_s / pairs
    return often, Estimate(pair_s, pair_s * often.error / often.value)


def findings(runs: Runs) -> Sequence[Finding]:
    """Return what was measured of each link, of one qubit at either end."""
    found = []
    for (km, flights), (modes, _scale) in LINKS.items():
        run = runs[f"{km}-km-{flights}"]
        took_s = run.times_s("herald")[-1] - run.times_s("attempt")[-1]
        asking = run.result["asking"]
        ours = measured(asking["emitted"], asking["attempts"], took_s * modes)
        if flights:
            closed = Published(mean_s(km, flights)[1], 0.0, "p c / 2L")
            found.append(Finding("", f"s a pair, {km} km, by round trips", ours[1], closed))
            continue
        theirs = measured(*TOLD["links"][str(km)])
        for chart, what, our, their in zip(CHARTS, WHAT, ours, theirs, strict=True):
            published = Published(their.value, their.error, TOLD["program"])
            found.append(Finding(chart, f"{what}, {km} km", our, published, km))
    return found


TIMES = Chart("times", "a link", "km", "s a pair", lambda km: mean_s(km, 0)[1], logarithmic=True)
LAB = Lab(
    title="times of heralded links, beside SeQUeNCe's",
    paper="Chung et al., Cross-Validating Quantum Network Simulators (2025), arXiv:2504.01290",
    runs={f"{km}-km-{flights}": said(km, flights) for km, flights in LINKS},
    findings=findings,
    charts=[TIMES],
)
