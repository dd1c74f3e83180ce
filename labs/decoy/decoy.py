"""Decoy-state BB84: what is seen, errors, and the key, over distance (arXiv:1311.7129)."""

from collections.abc import Sequence

import numpy as np

from applications.qkd.decoy import SHARES, Decoys
from applications.qkd.key_length import binary_entropy
from evidence.curves import bb84 as paper
from evidence.curves import finite_keys, theory
from evidence.curves.estimates import Estimate, proportion
from evidence.labs import finite_reach
from evidence.labs.lab import Chart, Finding, Lab, Published, PublishedRow, Runs

PAPER = finite_reach.PAPER
MORE = Published(1.75, 0.025, "section IV: about 1.75 times")
MEANS = (0.5, paper.WEAK, 0.0)
# By distance (km); with few bits, pulses without light are too few for a bound.
SIFTED = {0: 100_000, 10: 60_000, 25: 40_000, 50: 20_000, 100: 200_000, 150: 200_000}
FIBERS = 2  # from alice to bob, by a switch
SESSION = (
    "run qkd --bound asymptotic --captures none --without report,record"
    f" --device alice.source.statistics=poisson --device alice.source.mean_pairs={MEANS[0]}"
    f" --device 'alice.source.decoys=[{MEANS[1]}, {MEANS[2]}]'"
    f" --device bob.detectors.efficiency={paper.EFFICIENCY}"
    f" --device bob.detectors.dark_count_hz={paper.DARK_COUNT / 1e-9:g}"
    f" --fiber depolarizing={1 - (1 - 2 * paper.ERROR) ** (1 / FIBERS):.9f}"
    f" --loss-db-per-km {paper.LOSS_DB_PER_KM} --loss-budget-db 40"
)


def seen(distance_km: float) -> list[tuple[float, float]]:
    arrives = paper.EFFICIENCY * theory.transmission(paper.LOSS_DB_PER_KM * distance_km)
    return [theory.weak_pulse(mean * arrives, paper.DARK_COUNT, paper.ERROR) for mean in MEANS]


def gain(distance_km: float) -> float:
    return sum(share * each for share, (each, _) in zip(SHARES, seen(distance_km), strict=True))


def qber(distance_km: float) -> float:
    """Return how many of the sifted bits are wrong."""
    wrong = sum(share * each for share, (_, each) in zip(SHARES, seen(distance_km), strict=True))
    return wrong / gain(distance_km)


def secret(distance_km: float) -> float:
    """Return the secret bits of a pulse, with the paper's error correction."""
    return theory.decoy_key(MEANS, SHARES, seen(distance_km), paper.CORRECTION)


def secret_error(distance_km: float, pulses: int) -> float:
    """Return the standard error of that: the error of counts as they should be."""
    counts = np.zeros((2, 2, 3), np.int64)  # basis, wrong, level
    for level, (share, (each, wrong)) in enumerate(zip(SHARES, seen(distance_km), strict=True)):
        counts[:, :, level] = np.array([each - wrong, wrong]) * share * pulses / 4
    return paper.decoy_key(Decoys(MEANS), counts, pulses).error


def more() -> Estimate:
    """Return how many times the key at 100 km is more where n_X is 10^9 bits and not 10^7."""
    return Estimate(finite_keys.best_rate(1e9, 100) / finite_keys.best_rate(1e7, 100), 0.0)


def findings(runs: Runs) -> Sequence[Finding]:
    """Return gain, errors and key of each distance beside the paper's closed forms."""
    rows = []
    for km, run in zip(SIFTED, runs.values(), strict=True):
        report = run.job.asking
        pulses, sample = report.photons, report.disclosed_bits
        # The paper's leak of error correction in place of the one here.
        spent = paper.CORRECTION * (report.sifted_bits - sample) * binary_entropy(report.qber)
        bits = (report.key_bits + report.leaked_bits - spent) / pulses
        for chart, what, ours, theirs in (
            ("gain", "pulses seen", proportion(report.raw_bits, pulses), gain(km)),
            ("qber", "errors", proportion(round(report.qber * sample), sample), qber(km)),
            ("key", "secret bits a pulse", Estimate(bits, secret_error(km, pulses)), secret(km)),
        ):
            where = "equations A4 to A6" if chart == "key" else "section IV"
            published = Published(theirs, 0.0, where)
            rows.append(Finding(chart, f"{what}, {km} km", ours, published, km))
    return rows


LAB = Lab(
    title="decoy-state BB84: key over distance",
    paper=f"Lim, Curty, Walenta, Xu, Zbinden, Phys. Rev. A 89, 022307 (2014), {PAPER}",
    runs={
        f"{km}-km": f"{SESSION} --length-km {km / FIBERS} --count {sifted}"
        for km, sifted in SIFTED.items()
    },
    findings=findings,
    rows=[
        PublishedRow(PAPER, "key at 100 km, of n_X = 10^9 bits over that of 10^7", MORE, more),
        finite_reach.ROW,
    ],
    files=finite_reach.draw_finite,
    charts=(
        Chart("gain", "pulses of three intensities", "distance (km)", "pulses seen", gain, True),
        Chart("qber", "their errors", "distance (km)", "error rate", qber),
        Chart(
            "key",
            "the key of endless sessions",
            "distance (km)",
            "secret bits a pulse",
            secret,
            True,
        ),
    ),
)
