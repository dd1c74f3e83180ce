"""Benchmarks of key distribution: raw, sifted and final bits/s over a real network."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from qmn.benchmarks.service_session import one_session
from topologies.network import Network, Signals
from topologies.runtime import Runtime
from topologies.sdc import SdcTopo

PROTOCOLS = ("bb84", "bbm92")
DEPOLARIZING = 0.01  # of each fibre
SIFTED_BITS = 1_000_000


def key_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each benchmark."""
    runtime = Runtime(log_folder=folder / "keys")
    with Network(partial(SdcTopo, depolarizing=DEPOLARIZING), runtime, signals) as network:
        for protocol in PROTOCOLS:
            told = one_session(network, protocol, count=SIFTED_BITS)
            yield (
                f"{protocol}, QBER {told['qber']:.4f}",
                f"raw {told['raw_bits_per_s'] / 1e6:.2f} Mbit/s, "
                f"sifted {told['sifted_bits_per_s'] / 1e6:.2f} Mbit/s, while light is sent",
            )
            yield (
                "  with error correction and all",
                f"final key {told['key_bits_per_s'] / 1e3:.0f} kbit/s: {told['key_bits']:,} bits "
                f"in {told['elapsed_s']:.1f} s",
            )
