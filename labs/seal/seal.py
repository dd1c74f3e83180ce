"""A tamper-indicating seal: who intercepts and resends is found (arXiv:1508.05334)."""

from collections.abc import Sequence

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs, exactly

FALSE_ALARM, MISSED = 1e-9, 1e-4  # abstract: 1e-9, and detection with more than .9999
INTERVAL_S = 10.0  # abstract: sampling interval
COMPARED = 40_000
WATCH = f"--false-alarm {FALSE_ALARM:g} --missed {MISSED:g} --captures none --without report"
# Tests that take this share of differing pairs for a whole fibre go on, to be counted.
PATIENT = f"run seal --whole-error 0.2 --fraction 1 --count {COMPARED} {WATCH}"
TAPPED = {"whole": 0.0, "a-quarter": 0.25, "half": 0.5, "seven-tenths": 0.7}
FOUND = f"run seal --fraction 1 --count {COMPARED} {WATCH}"


def visibility(fraction: float) -> float:
    """Return the visibility where a fraction is measured in Z or X and sent on: 1 - f/2."""
    return 1 - fraction / 2


def findings(runs: Runs) -> Sequence[Finding]:
    """Return the visibilities, and whether the intruder, and nobody else, was found in time."""
    rows = []
    for name, fraction in TAPPED.items():
        report = runs[name].job.asking
        wrong = proportion(round(report.error_rate * report.compared), report.compared)
        seen = Estimate(1 - 2 * wrong.value, 2 * wrong.error)
        theirs = Published(visibility(fraction), 0, "one of four that are intercepted differs")
        rows.append(
            Finding("visibility", f"visibility, {fraction:g} tapped", seen, theirs, fraction)
        )
    alarm, silence = (runs[name].job.asking for name in ("intruder", "nobody"))
    in_time = alarm.alarm and alarm.light_s <= INTERVAL_S
    source = "abstract: false alarm 1e-9, detection above .9999, in 10 s"
    return [
        *rows,
        exactly("alarms within 10 s of an intruder", int(in_time), 1, source),
        exactly("alarms without one", int(silence.alarm), 0, source),
    ]


LAB = Lab(
    title="a tamper-indicating seal: who intercepts and resends is found",
    paper="Williams, Britt, Humble, Phys. Rev. Applied 5, 014001 (2016), arXiv:1508.05334",
    runs={
        **{
            name: PATIENT + (f" --eve {fraction:g}" if fraction else "")
            for name, fraction in TAPPED.items()
        },
        "intruder": f"{FOUND} --eve 1",
        "nobody": FOUND,
    },
    findings=findings,
    charts=(
        Chart(
            "visibility",
            "pairs measured in equal bases",
            "fraction of the photons that are intercepted and resent",
            "visibility",
            visibility,
        ),
    ),
)
