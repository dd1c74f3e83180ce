"""Points of a sweep: those that share networks, beside those with a network each."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

from evidence.curves.beside import in_networks
from evidence.curves.experiment import SweepError
from evidence.networks.job_sweep import grid_of
from topologies.networks.network import Signals
from topologies.system.processes.programs import NetworkError

JOB, PAIRS = "distribute", 1_000
OWN_NETWORKS = 3  # one after the other, on each processor
SHARED = 100  # points on a network for each processor


def sweep_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield points/s of both, starts and ends of networks included; raise NetworkError."""
    processors = os.cpu_count() or 1
    points, networks = processors * SHARED, processors * OWN_NETWORKS
    shared = {"count": f"{PAIRS - points // 2}:{PAIRS + (points - 1) // 2}"}
    own = {"count": str(PAIRS), "length_km": f"0.001:0.01:{networks}"}
    rates = [points_per_s(axes, folder / "sweep", processors, signals) for axes in (shared, own)]
    yield (
        f"sweep of {JOB}, {PAIRS:,} pairs a point",
        f"{rates[0]:.2f} points/s, {SHARED} a network, {processors} networks at a time; "
        f"{rates[0] / rates[1]:.1f} times those with a network each",
    )


def points_per_s(axes: dict[str, str], runs: Path, at_once: int, signals: Signals) -> float:
    grid = grid_of(JOB, axes)
    measure, points = in_networks(runs, at_once, signals.check), [*grid.points()]
    began_s = time.perf_counter()
    try:
        count = sum(1 for _ in measure(grid, points, 1))
    except SweepError as error:
        raise NetworkError(f"the sweep failed: {error}") from error
    return count / (time.perf_counter() - began_s)
