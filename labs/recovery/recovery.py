"""Fibres between two buildings are cut, and light goes by a third (arXiv:2407.20443)."""

import shlex
from collections.abc import Sequence
from math import hypot
from pathlib import Path

from qmn.labs.lab import Finding, Lab, Published, Runs, in_range
from qmn.sweeps.estimates import Estimate, proportion

HERE = shlex.quote(str(Path(__file__).parent))


def findings(runs: Runs) -> Sequence[Finding]:
    """Return what the detour does to light and F, how long it is dark, and F of all channels."""
    found, wide = runs["cut"].result["found"], runs["wide"].result["job"]["asking"]
    both = found["before"], found["after"]
    light = [proportion(each["came"], each["emitted"]) for each in both]
    like = [proportion(each["like_phi"], each["sampled"]) for each in both]  # (2F + 1)/3 of them
    times = light[0].value / light[1].value
    less = Estimate(times, times * hypot(*(each.error / each.value for each in light)))
    change = [1.5 * (like[1].value - like[0].value), 1.5 * hypot(*(each.error for each in like))]
    wrong = proportion(round(wide["error_rate"] * wide["compared"]), wide["compared"])
    f = Estimate(1 - 1.5 * wrong.value, 1.5 * wrong.error)
    return [
        Finding("", "light, times less", less, Published(10.9, 0.05, "C1"), inputs=0.0094 * times),
        in_range("F after, less F before", Estimate(*change), -0.031, 0.013, "three links"),
        in_range("s until light comes again", Estimate(found["outage_s"], 0), 0, 5, "about 5 s"),
        Finding("", "F, all channels", f, Published(0.76, 0.02, "B2 and C2"), inputs=0.008),
    ]


LAB = Lab(
    title="six nodes in three buildings: fibres are cut, and light goes another way",
    paper="Alshowkan et al., J. Lightwave Technol. 43, 9016 (2025), arXiv:2407.20443",
    runs={
        "cut": f"script {HERE}/cut_short.py",
        "wide": f"run seal --topology {HERE}/campus.py:Campus --from alice --to bailey --count 1000"
        " --block-pairs 262144 --rate-hz 50000000 --whole-error 0.2 --fraction 1 --missed 1e-4"
        " --false-alarm 1e-9 --captures none --no-report --fiber q1-q2.connectors_db=40"
        " --device source.source.statistics=poisson --device source.source.mean_pairs=0.5023",
    },
    findings=findings,
)
