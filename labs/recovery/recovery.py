"""Fibres between two buildings are cut, and light goes by a third (arXiv:2407.20443)."""

import shlex
from collections.abc import Sequence
from math import hypot, log
from pathlib import Path

from qmn.labs.lab import Finding, Lab, Published, Runs, in_range
from qmn.sweeps.estimates import Estimate, proportion

LOSS_ERROR = log(10) / 10 * 0.1 / 6**0.5  # of the ratio of two losses rounded to 0.1 dB
SINGLES = Published(10.9, 0.05, "singles of C1, cut A-C")


def findings(runs: Runs) -> Sequence[Finding]:
    """Return how much less light comes by the detour, what F does, and how long it is dark."""
    found = runs["cut"].result["found"]
    both = found["before"], found["after"]
    light = [proportion(each["came"], each["emitted"]) for each in both]
    like = [proportion(each["like_phi"], each["sampled"]) for each in both]  # (2F + 1)/3 of them
    times = light[0].value / light[1].value
    less = Estimate(times, times * hypot(*(each.error / each.value for each in light)))
    change = [1.5 * (like[1].value - like[0].value), 1.5 * hypot(*(each.error for each in like))]
    return [
        Finding("", "light, times less", less, SINGLES, inputs=times * LOSS_ERROR),
        in_range("F after, less F before", Estimate(*change), -0.031, 0.013, "three links"),
        in_range("s until light comes again", Estimate(found["outage_s"], 0), 0, 5, "about 5 s"),
    ]


LAB = Lab(
    title="six nodes in three buildings: fibres are cut, and light goes another way",
    paper="Alshowkan et al., J. Lightwave Technol. 43, 9016 (2025), arXiv:2407.20443",
    runs={"cut": f"script {shlex.quote(str(Path(__file__).with_name('cut_short.py')))}"},
    findings=findings,
)
