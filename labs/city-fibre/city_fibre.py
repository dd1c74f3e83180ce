"""Pairs through a city: fidelity over brightness (arXiv:2404.08626) and length (2504.08927)."""

from collections.abc import Sequence
from math import exp, log10
from pathlib import Path

from scipy.optimize import brentq

from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, PublishedRow, Run, Runs, in_range

# Pairs/s behind the fibre. Two bases bound F by the visibility V, and by (1 + V)/2.
RATES = {"brightest": 5e5, "middle": 2e5, "dimmest": 2e4}
COUNTS = {"brightest": 10_000, "middle": 10_000, "dimmest": 3_000}  # sifted bits
LOWER = {
    "brightest": Published(0.84, 0.005, "New York: more than 0.84"),
    "middle": Published(0.937, 0.007, "New York: 15 days, lower bound"),
}
UPPER = {"middle": Published(0.967, 0.004, "New York: 15 days, upper bound")}
BEST = Published(0.99, 0.005, "New York: about 0.99")
NEAR, FAR, FIBER_DB, KM, TOTAL_DB = 0.68, 0.90, 14.45, 34, 17.46  # detectors: 795, 1324 nm
# Classical light in Berlin (mW, dB/km), scattered on each km and nm, width (nm), where, s.
CLASSICAL = 74.1, 0.2, 6.5255e-14, 0.4, 1324, 1e-9
BERLIN, E91 = {"10-m": 0.01, "30-km": 30.0, "60-km": 60.0}, "e91 --chsh-fraction 0.5"


def visibility(light: float) -> float:
    """Return V where the near detectors have `light` photons each, on average, of other pairs.

    Behind the fibre light is rare, and of one pair; two clicks at once are a random bit.
    """
    return NEAR * exp(-light) / (1 - (1 - NEAR) * exp(-2 * light))


def light(rate: float, brightest: float = LOWER["brightest"].value) -> float:
    """Return the light at a rate of pairs/s, where the brightest source has this visibility."""
    most = float(brentq(lambda x: visibility(x) - brightest, 0.0, 1.0))
    return most * rate / RATES["brightest"]


def lower(rate: float) -> float:
    return visibility(light(rate))


def unsure(rate: float) -> float:
    """Return the error of V that follows from rounding that of the brightest."""
    point = LOWER["brightest"]
    unlike = visibility(light(rate, point.value + point.error)) - lower(rate)
    return unlike if rate != RATES["brightest"] else 0.0


def session(protocol: str, count: int, rate: float, km: float, lit: str = "") -> str:
    """Return the words behind `qmn`."""
    text = "".join(
        Path(__file__).with_name(name).read_text() for name in ("session.txt", lit) if name
    )
    return text.format(protocol=protocol, count=count, mean=2 * light(rate) / NEAR, km=km)


def beside(km: float) -> float:
    """Return F at the middle rate beside the classical light: its photons are random bits."""
    comes = FAR * theory.transmission(TOTAL_DB - FIBER_DB)
    noise = comes * theory.scattered_photons(km, FIBER_DB / KM, *CLASSICAL)
    ways = NEAR, comes * theory.transmission(FIBER_DB / KM * km)
    mean, noises = 2 * light(RATES["middle"]) / NEAR, (0.0, 1 - exp(-noise / 2))
    return 1 - 1.5 * theory.several_pairs("poisson", mean, ways, noises)[0]


def wrong(run: Run) -> Estimate:
    report = run.job.asking
    return proportion(round(report.qber * report.disclosed_bits), report.disclosed_bits)


def less(error: Estimate, times: float) -> Estimate:
    """Return 1 - times * error: F for 3/2, its bounds for 2 and 1."""
    return Estimate(1 - times * error.value, times * error.error)


def row(name: str, what: str, times: float, theirs: Published) -> PublishedRow:
    """Return 1 - times * error, for the physical layer alone."""
    rate, further_db = RATES[name], TOTAL_DB - 10 * log10(FAR / NEAR)
    point = {"mean_pairs": 2 * light(rate) / NEAR, "loss_db": -10 * log10(NEAR)}
    points = [("multi-pair", {**point, "further_db": further_db, "pairs": 20_000_000})]
    label, inputs = f"{what}, {rate:g} pairs/s", unsure(rate) * times / 2
    return PublishedRow(
        "arXiv:2404.08626", label, theirs, lambda row: less(row["qber"], times), points, inputs
    )


def findings(runs: Runs) -> Sequence[Finding]:
    """Return the bounds of F at each brightness, then F and S over length."""
    rows = []
    for name, rate in RATES.items():
        q, error = wrong(runs[name]), unsure(rate)
        for chart, what, times, theirs in (
            ("lower", "at least", 2, LOWER.get(name)),
            ("upper", "at most", 1, UPPER.get(name)),
        ):
            label, inputs = f"F {what}, {rate:g} pairs/s", error * times / 2
            rows.append(Finding(chart, label, less(q, times), theirs, rate, inputs=inputs))
    rows.append(Finding("", f"F, {rate:g} pairs/s", less(q, 1.5), BEST, inputs=0.75 * error))
    for name, km in BERLIN.items():
        report, f = runs[name].job.asking, less(wrong(runs[name]), 1.5)
        s = Estimate(report.chsh, report.chsh_error)
        rows.append(Finding("km", f"F, {name}", f, Published(beside(km), 0, "closed form"), km))
        rows.append(in_range(f"F, {name}", f, 0.85, 0.99, "Berlin, abstract"))
        rows.append(in_range(f"S, {name}", s, 2.36, 2.74, "Berlin, abstract"))
    return rows


AXES = "pairs/s behind 34 km", "bound of the fidelity"
BOUNDS = {"lower": lower, "upper": lambda rate: (1 + lower(rate)) / 2}
LAB = Lab(
    title="pairs through a city: fidelity over brightness, and over length",
    paper="Craddock et al., PRX Quantum 5, 030330 (2024), arXiv:2404.08626;"
    " Sena et al., J. Opt. Commun. Netw. 17, 1072 (2025), arXiv:2504.08927",
    runs={name: session("bbm92", COUNTS[name], rate, KM) for name, rate in RATES.items()}
    | {name: session(E91, 1200, RATES["middle"], km, "lit.txt") for name, km in BERLIN.items()},
    findings=findings,
    rows=[row(name, "F at least", 2, theirs) for name, theirs in LOWER.items()]
    + [row("middle", "F at most", 1, UPPER["middle"]), row("dimmest", "F", 1.5, BEST)],
    charts=[Chart(name, f"{name} bound by two bases", *AXES, of) for name, of in BOUNDS.items()]
    + [Chart("km", "beside 18.7 dBm of classical light", "km", "fidelity", beside)],
)
