"""Mininet that does beside each other what it would do one after the other."""

import subprocess
from typing import Any

from mininet.node import Switch

from topologies.iperf import IperfMininet
from topologies.nodes import OpticalSwitch, QuantumController

REMOVAL_TIMEOUT_S = 30.0


class ParallelMininet(IperfMininet):
    """Starts programs before it waits for the first, and removes all links by one command."""

    def configHosts(self) -> None:  # noqa: N802 (Mininet's name)
        """Start controllers, whose start takes longest, then hosts."""
        for controller in self.controllers:
            if isinstance(controller, QuantumController):
                controller.launch()
        super().configHosts()

    def start(self) -> None:
        """Start all agents, then wait for everything."""
        for switch in self.switches:
            if isinstance(switch, OpticalSwitch):
                switch.launch(self.controllers)
        super().start()

    def stop(self) -> None:
        """Stop everything."""
        ends = [end for link in self.links for end in (link.intf1, link.intf2)]
        names = {str(end) for end in ends if isinstance(end.node, Switch)}  # on this machine
        subprocess.run(
            ["ip", "-force", "-batch", "-"],  # what is gone already is no fault
            input="".join(f"link delete {name}\n" for name in sorted(names)),
            capture_output=True,
            text=True,
            check=False,
            timeout=REMOVAL_TIMEOUT_S,
            start_new_session=True,
        )
        self.links: list[Any] = []  # nothing is left for Mininet to remove
        super().stop()
