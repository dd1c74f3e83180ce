"""A quantum switch whose every port changes its path at once, against a bare Open vSwitch."""

from functools import partial
from pathlib import Path

from mininet.topo import Topo

from qmn.benchmarks.measurement import Times
from qmn.benchmarks.path_setups import Baseline, baseline_times, start_baseline, times_of
from topologies.fabric import FIRST_DPID
from topologies.fiber import FiberLink
from topologies.network import Network, Signals
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch
from topologies.runtime import Runtime, free_port

PORTS = 16


class FullSwitchTopo(Topo):
    """q1, which the bench programs itself, and q2 at the other end of all its fibres.

    ed --- s1      q1 ===16=== q2
    """

    def build(self, controller_port: int) -> None:
        """Lay the fibres; they are q1's only ports."""
        self.addSwitch("s1", cls=ClassicalSwitch, dpid="1")
        self.addHost("ed", cls=DispatcherHost, ip="10.0.0.4/24")
        self.addLink("ed", "s1")
        for number, port in enumerate((controller_port, None), 1):
            dpid = f"{FIRST_DPID + number:x}"
            self.addSwitch(f"q{number}", cls=OpticalSwitch, dpid=dpid, controller_port=port)
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
