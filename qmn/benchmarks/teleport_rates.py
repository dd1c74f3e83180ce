"""Benchmarks of teleportation: qubits/s over a real network, each with its real two bits."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from qmn.benchmarks.service_session import one_session
from topologies.network import Network, Signals
from topologies.runtime import Runtime
from topologies.sdc import SdcTopo
from wire.parameters.network import NetworkSettings

DEPOLARIZING = 0.01  # of each fibre
STATES = 1_000_000
KINDS = (("chp", "random", "the six cardinal states"), ("dense", "haar", "states at random"))


def teleport_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each benchmark."""
    for backend, state, what in KINDS:
        runtime = Runtime(
            NetworkSettings(backend=backend), log_folder=folder / f"teleport-{backend}"
        )
        with Network(partial(SdcTopo, depolarizing=DEPOLARIZING), runtime, signals) as network:
            told = one_session(network, "teleport", count=STATES, state=state)
        yield (
            f"teleport, {backend}",
            f"{told['states_per_s']:,.0f} qubits/s: {told['states']:,} of {what} in "
            f"{told['elapsed_s']:.1f} s, fidelity {told['fidelity']:.4f}, "
            f"{told['waited_ms']:.1f} ms for their bits",
        )
