"""Teleportation beside classical light in the same fibre (after arXiv:2404.10738)."""

import shlex
from collections import namedtuple
from collections.abc import Sequence
from functools import partial
from math import hypot
from pathlib import Path

from evidence.curves import theory
from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Chart, Finding, Lab, Published, Runs

HERE = Path(__file__).parent
TRAFFIC_DBM, DARK, BEHIND_DB = 18.7, 5e-8, 1.2
ARM_KM, ARM_DB_PER_KM, WINDOW_S = 15.1, 0.16871, 5e-10
SCATTERED = 5e-5  # photons in a window, at the end of an arm

# Of a source: pairs and noise in a pulse, how often the half that stays is seen and the one that
# flies, the detector of that (dB), and its way (dB).
Source = namedtuple("Source", "pairs noise near far detector_db way_db")
ALICE = Source(0.018, 0.0027, 0.19, 0.07, 5.65, 10.81)
BOB = Source(0.013, 0.0022, 0.05, 0.09, 6.71, 10.64)


def scattered(dbm: float, raman_per_km_nm: float, nm: float) -> float:
    return theory.scattered_photons(
        ARM_KM, ARM_DB_PER_KM, 10 ** (dbm / 10), 0.2, raman_per_km_nm, 0.4, nm, WINDOW_S
    )


# The light scattered into the photons' filter on each km and nm, and its wavelength (nm).
BANDS: dict[str, tuple[float, float]] = {"c-band": (2e-9, 1550)}
BANDS["o-band"] = SCATTERED / scattered(TRAFFIC_DBM, 1, 1290), 1290
POINTS = [("o-band", -20.0, 12), ("o-band", 0.0, 12), ("o-band", 30.0, 12)]  # dBm, 10^6 pulses
POINTS += [("c-band", -10.0, 10), ("c-band", 0.0, 8), ("c-band", 10.0, 4), ("c-band", 18.7, 1)]


def behind(noise: float, detector_db: float) -> float:
    """Return the noise of a detector behind the beam splitter: light of arms and sources."""
    sources = sum(each.noise * theory.transmission(each.way_db) for each in (ALICE, BOB))
    light: float = 2 * noise * theory.transmission(BEHIND_DB) + sources
    return theory.transmission(detector_db) * light / 2 + DARK


def visibility(noise: float, of: Source) -> float:
    """Return that of a source's coincidences, beside so much noise at the end of either arm."""
    noises = of.near * of.noise + DARK, behind(noise, of.detector_db)
    return theory.coincidence_visibility(of.pairs, (of.near, of.far), noises)


def fidelity(band: str, dbm: float) -> float:
    noise = scattered(dbm, *BANDS[band])
    return (1 + visibility(noise, ALICE) * visibility(noise, BOB)) / 2


def settings(band: str, dbm: float) -> list[str]:
    """Return options and values: alice's fibre has the light of both arms."""
    raman, nm = BANDS[band]
    astray = (1 - visibility(scattered(dbm, raman, nm), ALICE)) / 2
    text = (HERE / "settings.txt").read_text()
    return text.format(mw=10 ** (dbm / 10), raman=2 * raman, nm=nm, astray=astray).split()


def findings(runs: Runs) -> Sequence[Finding]:
    """Return F at each power beside the closed form, and how much less it is beside traffic."""
    rows = []
    for name, run in runs.items():
        band, power = name.split("_")
        report, dbm = run.result.get("found") or vars(run.job.asking), float(power)
        ours = proportion(round(report["fidelity"] * report["arrived"]), report["arrived"])
        closed = Published(fidelity(band, dbm), 0.0, "supplement, S5 to S15")
        rows.append(Finding(band, f"F, {band}, {power} dBm", ours, closed, dbm))
    dark, lit = rows[0].ours, rows[-1].ours  # the last run is that beside traffic
    less = Estimate(dark.value - lit.value, hypot(dark.error, lit.error))
    difference = Finding("", "F, o-band, less beside traffic", less, Published(0, 0, "abstract"))
    return [*rows, difference, Finding("", "Gbit/s beside it", Estimate(report["gbit_per_s"], 0.0))]


COMMAND = "run teleport --state 0 --block-pairs 262144 --captures none --without report,record"
LAB = Lab(
    title="teleportation beside classical light in the same fibre",
    paper="Thomas et al., Optica 11, 1700 (2024), arXiv:2404.10738",
    runs={
        f"{band}_{dbm:g}": f"{COMMAND} --count {count}000000 {' '.join(settings(band, dbm))}"
        for band, dbm, count in POINTS
    }
    | {f"o-band_{TRAFFIC_DBM}": f"script {shlex.quote(str(HERE))}/beside_traffic.py"},
    findings=findings,
    charts=[
        Chart(band, f"photons at {nm} nm", "classical light (dBm)", "F", partial(fidelity, band))
        for band, (_raman, nm) in BANDS.items()
    ],
)
