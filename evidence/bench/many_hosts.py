"""Benchmarks of networks of many hosts, of which two use light and all others are idle."""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from evidence.bench.path_setups import path_setups
from evidence.traffic.job import CONTROLLER, controller_s
from qmn.timeouts import IDLE_S
from topologies.networks.network import Network, Signals
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import POLL_S
from topologies.tree import TreeTopo

HOSTS_AT_A_SWITCH = 4
SETUPS = 50


@dataclass(frozen=True)
class ManyHosts:
    """The cost of a network of a number of hosts."""

    hosts: int
    start_s: float
    end_s: float
    memory_mb: float  # of all its processes, without this one, what they share counted once
    controller_share: float  # of one processor, while nobody asks for light
    setup_ms: float  # of a light path, p50

    def __str__(self) -> str:
        return (
            f"start {self.start_s:.1f} s, end {self.end_s:.1f} s, {self.memory_mb:,.0f} MB, "
            f"{CONTROLLER} idle {100 * self.controller_share:.1f} % of a processor, "
            f"path {self.setup_ms:.1f} ms"
        )


def many_hosts_benchmarks(
    folder: Path, hosts: Sequence[int], signals: Signals
) -> Iterator[tuple[str, str]]:
    for count in hosts:
        yield (
            f"network of {count:,} hosts",
            str(measured(folder / f"hosts-{count}", count, signals)),
        )


def measured(folder: Path, hosts: int, signals: Signals) -> ManyHosts:
    switches = max(1, hosts // HOSTS_AT_A_SWITCH)
    topology = partial(TreeTopo, hosts=hosts, switches=switches)
    began = time.monotonic()
    with Network(topology, Runtime(log_folder=folder), signals) as network:
        started = time.monotonic()
        share = controller_share(network)
        memory_mb = network_memory_mb()
        setup_ms = path_setups(network, SETUPS).p50_ms
        ending = time.monotonic()
    ended = time.monotonic()
    return ManyHosts(hosts, started - began, ended - ending, memory_mb, share, setup_ms)


def controller_share(network: Network) -> float:
    began, before = time.monotonic(), controller_s(network)
    while time.monotonic() < began + IDLE_S:
        network.check()
        time.sleep(POLL_S)
    return (controller_s(network) - before) / (time.monotonic() - began)


def network_memory_mb() -> float:
    """Return the memory of all processes of this run but this one: each shared page once (PSS)."""
    kib, own = 0, str(os.getpid())
    for file in Path("/proc").glob("[0-9]*/smaps_rollup"):
        if file.parent.name == own:
            continue
        with suppress(ProcessLookupError, FileNotFoundError):  # it has ended
            lines = file.read_text().splitlines()
            kib += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return kib * 1024 / 1e6
