"""Benchmarks of services over a real network: keys, teleported qubits, swapped pairs."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from hosts.client import blocking_session
from qmn.timeouts import MEASURE_TIMEOUT_S
from topologies.chain import ChainTopo
from topologies.networks.network import Network, Signals
from topologies.sdc import SdcTopo
from topologies.system.open_vswitch import openvswitch
from topologies.system.runs.runtime import Runtime
from wire.parameters.network import NetworkSettings
from wire.results.figures import KeyFigures
from wire.results.time_series import figures

PORT = 9
DEPOLARIZING = 0.01  # of each fibre
PROTOCOLS = ("bb84", "bbm92")
SIFTED_BITS = 1_000_000
STREAM_BITS = 8 * SIFTED_BITS  # sifted, for keys one after another
STATES = 1_000_000
KINDS = (("chp", "random", "the six cardinal states"), ("dense", "haar", "states at random"))
LENGTHS = (1, 2, 4, 8)  # switches that swap
PAIRS = 100_000


class SwappingChain(ChainTopo):
    """alice and bob have no source between them: every switch swaps."""

    def build(self, switches: int = 3, fibers: int = 1, **fiber: Any) -> None:
        """Lay the chain with an analyser, two memories and a source in each switch."""
        super().build(switches, fibers, **fiber)
        for number in range(1, switches + 1):
            name = f"q{number}"
            parts = {"analysers": 1, "memories": 2, "sources": 1}
            self.setNodeInfo(name, {**self.nodeInfo(name), **parts})


def key_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of what keys take: raw, sifted and final bits/s, and processors."""
    topology = partial(SdcTopo, depolarizing=DEPOLARIZING)
    with Network(topology, Runtime(log_folder=folder / "stream"), signals) as network:
        yield keys_one_after_another(network)
    with Network(topology, Runtime(log_folder=folder / "keys"), signals) as network:
        for protocol in PROTOCOLS:
            figures = one_session(network, protocol, count=SIFTED_BITS)
            yield (
                f"{protocol}, QBER {figures.qber:.4f}",
                f"raw {figures.raw_bits_per_s / 1e6:.2f} Mbit/s, "
                f"sifted {figures.sifted_bits_per_s / 1e6:.2f} Mbit/s, while light is sent",
            )
            yield "  with error correction and all", f"final key {final_key(figures)}"


def keys_one_after_another(network: Network) -> tuple[str, str]:
    before_s = processors_s(network)
    figures = one_session(network, PROTOCOLS[0], count=STREAM_BITS)
    bit_us = (processors_s(network) - before_s) / figures.key_bits * 1e6
    text = f"{final_key(figures)}, {bit_us:.2f} us of processors for each"
    return f"{PROTOCOLS[0]}, keys one after another", text


def final_key(figures: KeyFigures) -> str:
    rate = f"{figures.key_bits_per_s / 1e3:.0f} kbit/s"
    return f"{rate}: {figures.key_bits:,} bits in {figures.elapsed_s:.1f} s"


def processors_s(network: Network) -> float:
    programs = *network.runtime.programs, *openvswitch.programs()
    return sum(program.processor_s for program in programs)


def teleport_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of qubits/s, each with its real two bits."""
    for backend, state, what in KINDS:
        runtime = Runtime(
            NetworkSettings(backend=backend), log_folder=folder / f"teleport-{backend}"
        )
        with Network(partial(SdcTopo, depolarizing=DEPOLARIZING), runtime, signals) as network:
            figures = one_session(network, "teleport", count=STATES, state=state)
        yield (
            f"teleport, {backend}",
            f"{figures.states_per_s:,.0f} qubits/s: {figures.states:,} of {what} in "
            f"{figures.elapsed_s:.1f} s, fidelity {figures.fidelity:.4f}, "
            f"{figures.waited_ms:.1f} ms for their bits",
        )


def swap_benchmarks(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    for switches in LENGTHS:
        topology = partial(SwappingChain, switches=switches)
        runtime = Runtime(log_folder=folder / f"switches-{switches}")
        with Network(topology, runtime, signals) as network:
            figures = one_session(network, "swap", count=PAIRS, sample=0, swaps=switches)
        plural = "es" if switches > 1 else ""
        yield (
            f"swapped by {switches} switch{plural}",
            f"{figures.pairs_per_s:,.0f} pairs/s: {figures.pairs:,} in {figures.elapsed_s:.2f} s",
        )


def one_session(network: Network, service: str, **options: Any) -> Any:
    """Have alice ask bob for a service; return her figures."""
    options["limit_s"] = MEASURE_TIMEOUT_S
    stacks = network.runtime.socket
    with blocking_session(stacks, service, ("alice", "bob"), PORT, **options) as session:
        session.results()
        session.end()
    return figures(session.summary)
