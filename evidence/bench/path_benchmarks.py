"""Benchmarks of light paths: over one switch and more, beside baselines of the same run."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mininet.topo import Topo

from evidence.bench.measurement import Times
from evidence.bench.path_setups import (
    Baseline,
    baseline_times,
    path_setups,
    start_baseline,
    times_of,
)
from topologies.chain import ChainTopo
from topologies.links.fiber import FiberLink
from topologies.networks.network import Network, Signals
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch
from topologies.system.runs.runtime import Runtime, free_port

PORTS = 16
LONGEST = 3  # switches in a line
ROUNDS = 2  # the load of a machine changes: a path and its baselines take turns
FULL_TURNS = 100


class FullSwitchTopo(Topo):
    """q1, which the bench programs itself, and q2 at the other end of all its fibres.

    ed --- s1      q1 ===16=== q2
    """

    def build(self, controller_port: int) -> None:
        """Lay the fibres; they are q1's only ports."""
        self.addSwitch("s1", cls=ClassicalSwitch)
        self.addHost("ed", cls=DispatcherHost, ip="10.0.0.4/24")
        self.addLink("ed", "s1")
        for number, port in enumerate((controller_port, None), 1):
            self.addSwitch(f"q{number}", cls=OpticalSwitch, controller_port=port)
        for _ in range(PORTS):
            self.addLink("q1", "q2", cls=FiberLink)


def full_switch(folder: Path, signals: Signals, count: int) -> tuple[Times, Times]:
    """Return the times by the agent, until light passes, and those of Open vSwitch alone."""
    port = free_port()
    topo = partial(FullSwitchTopo, controller_port=port)
    with Network(topo, Runtime(log_folder=folder), signals) as network:
        baseline = Baseline("full", count, ports=PORTS)
        agent = times_of(network, start_baseline(network, baseline, port))
        return agent, baseline_times(network, baseline)


def path_benchmarks(folder: Path, count: int, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each benchmark, from that many set-ups of each kind."""
    medians = []
    for switches in range(1, LONGEST + 1):
        topo = partial(ChainTopo, switches=switches)
        runtime = Runtime(log_folder=folder / f"chain-{switches}")
        with Network(topo, runtime, signals) as network:
            if switches == 1:
                setups, learning, bundle = beside_baselines(network, count)
            else:
                setups = path_setups(network, count)
        plural = "es" if switches > 1 else ""
        yield f"light path, {switches} switch{plural}", f"{setups}"
        yield "  opened and closed", f"{setups.per_s:.0f}/s, one after the other"
        medians.append(setups.p50_ms)
        if switches == 1:
            yield "baseline: learning switch", f"{learning}"
            yield "baseline: bundle and barrier", f"{bundle}"
            yield "light path to bundle and barrier", ratio(setups, bundle)
    growth_ms = (medians[-1] - medians[0]) / (LONGEST - 1)
    yield "light path, each switch more", f"p50 {growth_ms:.2f} ms"
    agent, bare = full_switch(folder / "full-switch", signals, FULL_TURNS)
    yield f"{PORTS} ports in a bundle, light", f"{agent}"
    yield f"{PORTS} ports in a bundle, bridge only", f"{bare}"
    yield "light to bridge only", ratio(agent, bare)


def beside_baselines(network: Network, count: int) -> tuple[Times, Times, Times]:
    setups, learning, bundle = Times(), Times(), Times()
    for part in parts(count, ROUNDS):
        paths = path_setups(network, part)
        period_s = paths.seconds / part
        setups += paths
        learning += baseline_times(network, Baseline("learning", part, period_s))
        bundle += baseline_times(network, Baseline("bundle", part, period_s))
    return setups, learning, bundle


def parts(count: int, rounds: int) -> list[int]:
    return [max(1, (count + number) // rounds) for number in range(rounds)]


def ratio(measured: Times, baseline: Times) -> str:
    return f"{measured.p50_ms / baseline.p50_ms:.2f} times {baseline.p50_ms:.2f} ms"
