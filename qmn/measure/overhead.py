"""What seeing everything costs: runs with all captures and the event log beside runs without.

Runs of both kinds take turns, so that a machine that gets slower slows both.
"""

import json
import os
import statistics
import subprocess
from collections.abc import Iterator
from pathlib import Path

from topologies.network import Signals
from topologies.programs import NetworkError, python

BYTES = 4 << 20
ROUNDS = 5
TIMEOUT_S = 120.0
KINDS: dict[str, list[str]] = {
    "without": ["--no-capture", "--no-events"],
    "events alone": ["--no-capture"],
    "captures alone": ["--no-events"],
    "with everything": [],
}


def overhead_figures(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and figure of each kind of run; raise NetworkError if one fails."""
    file = folder / "message"
    file.write_bytes(os.urandom(BYTES))
    rates: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for _ in range(ROUNDS):
        for kind, options in KINDS.items():
            signals.check()
            rates[kind].append(pairs_per_s(file, folder / "runs", options))
    medians = {kind: statistics.median(found) for kind, found in rates.items()}
    for kind, median in medians.items():
        share = median / medians["without"]
        yield f"qmn run sdc, {kind}", f"{median:,.0f} Bell pairs/s, {share:.0%}"


def pairs_per_s(file: Path, runs: Path, options: list[str]) -> float:
    """Return the Bell pairs a second of one run, from the first byte to the verified last."""
    words = ["run", "sdc", "--file", str(file), "--runs", str(runs), *options]
    try:
        done = subprocess.run(
            [python(), "-m", "qmn", *words],
            capture_output=True,
            text=True,
            check=False,
            timeout=TIMEOUT_S,
        )
    except subprocess.TimeoutExpired as error:
        raise NetworkError(f"qmn run sdc {' '.join(options)} took {TIMEOUT_S:g} s") from error
    if done.returncode:
        raise NetworkError(f"qmn run sdc failed: {done.stderr.strip()}")
    result = json.loads((runs / "latest" / "result.json").read_text())
    return float(result["pairs_per_s"])
