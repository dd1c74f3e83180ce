"""Fibres between two buildings are cut, and light goes by a third (arXiv:2407.20443)."""

from collections.abc import Sequence
from math import hypot
from pathlib import Path

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs, in_range

LOSS, FAST = "of another pair than before; loss changes nothing here", "switches in 100 ns here"
HERE, WAY = Path(__file__).parent, "loss from the source to the farther host (dB)"
WIDE = (HERE / "wide.txt").read_text().format(here=HERE)


def findings(runs: Runs) -> Sequence[Finding]:
    """Return what the detour does to light and F, how long it is dark, and F of all channels."""
    outage, wide = runs["cut"].result["found"], runs["wide"].job.asking
    both, dark = (outage["before"], outage["after"]), Estimate(outage["outage_s"], 0.0)
    light = [proportion(each["came"], each["emitted"]) for each in both]
    like = [proportion(each["like_phi"], each["sampled"]) for each in both]  # (2F + 1)/3 of them
    times = light[0].value / light[1].value
    less = Estimate(times, times * hypot(*(each.error / each.value for each in light)))
    ours = [Estimate(1.5 * each.value - 0.5, 1.5 * each.error) for each in like]
    change = Estimate(ours[1].value - ours[0].value, hypot(*(each.error for each in ours)))
    wrong = proportion(round(wide.error_rate * wide.compared), wide.compared)
    f = Estimate(1 - 1.5 * wrong.value, 1.5 * wrong.error)
    return [
        Finding("", "light, times less", less, Published(10.9, 0.05, "C1"), inputs=0.0094 * times),
        in_range("F after, less F before", change, -0.031, 0.013, "three links"),
        Finding("fidelity", "F before", ours[0], Published(0.978, 0.002, "A2 and C1"), 17.2),
        Finding("fidelity", "F after", ours[1], Published(0.947, 5e-4, "A1 and C1", 0, LOSS), 27.5),
        in_range("s until light comes again", dark, 0, 5, "about 5 s"),
        Finding("outage", "s dark", dark, Published(5, 0.5, "about 5 s", 0, FAST), 27.5),
        Finding("fidelity", "F, all channels", f, Published(0.76, 0.02, "B2 and C2"), 28, 0, 0.008),
    ]


LAB = Lab(
    title="six nodes in three buildings: fibres are cut, and light goes another way",
    paper="Alshowkan et al., J. Lightwave Technol. 43, 9016 (2025), arXiv:2407.20443",
    runs={"cut": f"script '{HERE}/cut_short.py'", "wide": WIDE},
    findings=findings,
    charts=[Chart("fidelity", "three ways", WAY, "F"), Chart("outage", "detour", WAY, "s dark")],
)
