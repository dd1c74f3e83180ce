"""Benchmarks of entanglement swapping: pairs/s by length of the chain, over a real network."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from qmn.benchmarks.service_session import one_session
from topologies.network import Network, Signals
from topologies.repeaters import RepeatersTopo
from topologies.runtime import Runtime

LENGTHS = (1, 2, 4, 8)  # repeaters
PAIRS = 100_000


def swap_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each benchmark."""
    for repeaters in LENGTHS:
        topology = partial(RepeatersTopo, repeaters=repeaters)
        runtime = Runtime(log_folder=folder / f"repeaters-{repeaters}")
        with Network(topology, runtime, signals) as network:
            told = one_session(network, "swap", count=PAIRS, sample=0)
        plural = "s" if repeaters > 1 else ""
        yield (
            f"swapped by {repeaters} repeater{plural}",
            f"{told['pairs_per_s']:,.0f} pairs/s: {told['pairs']:,} in {told['elapsed_s']:.2f} s",
        )
