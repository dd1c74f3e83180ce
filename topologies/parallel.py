"""Mininet that does beside each other what it would do one after the other."""

from contextlib import ExitStack

from mininet.node import Switch

from topologies import openvswitch, runtime
from topologies.iperf import IperfMininet
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumController


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
        """Stop everything; go on where one thing fails, and raise that at the end."""
        with ExitStack() as steps:
            for node in (*self.hosts, *self.controllers, *self.switches):
                steps.callback(node.terminate)
            ours = [switch for switch in self.switches if isinstance(switch, ClassicalSwitch)]
            for switch in self.switches:
                if switch not in ours:
                    steps.callback(switch.stop)
            steps.callback(ClassicalSwitch.batchShutdown, ours)
            ends = [end for link in self.links for end in (link.intf1, link.intf2)]
            names = {str(end) for end in ends if isinstance(end.node, Switch)}  # on this machine
            names |= runtime.current().management
            steps.callback(openvswitch.delete_interfaces, sorted(names))
            for controller in self.controllers:
                steps.callback(controller.stop)
            if self.terms:
                steps.callback(self.stopXterms)
