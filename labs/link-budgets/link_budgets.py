"""Key rates of links by their loss budget, from photons (doi 10.1109/MNET.2025.3540705)."""

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evidence.curves.estimates import Estimate, proportion
from evidence.labs.lab import Finding, Lab, Published, Runs

THEIRS = tomllib.loads(Path(__file__).with_name("figures.toml").read_text())
LINKS = {f"{link['km']}-km": link for link in THEIRS["links"]}
_MEAN, RECEIVER, EFFICIENCY = THEIRS["light"]
INTENSITIES = 0.7, 0.2, 0.0  # 0.42 on average, by the shares of the product's decoys
FIBERS = 2  # from alice to bob, by a switch
HALF_A_UNIT = 0.5


def command_for(link: dict[str, Any]) -> str:
    signal, *decoys = INTENSITIES
    return (
        "run qkd --bound asymptotic --captures none --without report,record --count 200000"
        f" --rate-hz {THEIRS['pulses_hz']:.0f} --length-km {link['km'] / FIBERS}"
        f" --loss-db-per-km {link['db_per_km']} --loss-budget-db 40"
        f" --device alice.source.statistics=poisson --device alice.source.mean_pairs={signal}"
        f" --device 'alice.source.decoys={decoys}'"
        f" --device bob.detectors.efficiency={EFFICIENCY}"
        f" --fiber q1-bob.connectors_db={-10 * math.log10(RECEIVER):.6f}"
    )


def findings(runs: Runs) -> Sequence[Finding]:
    """Return the rate of clicks, times the published shares of processing, beside that of keys."""
    rows = []
    for name, run in runs.items():
        keys, link = run.job.asking, LINKS[name]
        seen = proportion(keys.raw_bits, keys.photons)
        scale = THEIRS["pulses_hz"] * math.prod(THEIRS["processing"])
        ours = Estimate(seen.value * scale, seen.error * scale)
        published = Published(link["key_hz"], HALF_A_UNIT, "link budget")
        rows.append(Finding("", f"bit/s, {link['km']} km", ours, published))
    return rows


LAB = Lab(
    title="key rates of links by their loss budget, from photons",
    paper="Mehic et al., IEEE Network (2025), doi 10.1109/MNET.2025.3540705",
    runs={name: command_for(link) for name, link in LINKS.items()},
    findings=findings,
)
