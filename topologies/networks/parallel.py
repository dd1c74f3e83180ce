"""Mininet that does beside each other what it would do one after the other."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

from mininet.node import Host, Switch

from topologies.links.fiber import channels_of
from topologies.networks.heard_orders import HeardOrders
from topologies.networks.iperf import IperfMininet
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumController
from topologies.system.kernel import interfaces
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.shells import ShellWatcher
from topologies.system.runs import runtime

AT_ONCE = 4  # hosts: their shells do most of it, and wait for the kernel


class ParallelMininet(HeardOrders, IperfMininet):
    """Starts programs before it waits for the first, and removes all links by one command."""

    def configHosts(self) -> None:  # noqa: N802 (Mininet's name)
        """Start controllers, whose start takes longest, then hosts."""
        for controller in self.controllers:
            if isinstance(controller, QuantumController):
                controller.launch()
        pool = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="configure")
        try:
            for configured in [pool.submit(self._configure, host) for host in self.hosts]:
                configured.result()
        finally:
            pool.shutdown(cancel_futures=True)

    @staticmethod
    def _configure(host: Host) -> None:
        host.configDefault(**({} if host.defaultIntf() else {"ip": None, "mac": None}))

    def start(self) -> None:
        """Make all bridges together and start all agents, then wait for everything."""
        ours = [switch for switch in self.switches if isinstance(switch, ClassicalSwitch)]
        with openvswitch.one_transaction():
            for switch in ours:
                switch.lay()
        openvswitch.require_made(switch.name for switch in ours)
        for switch in ours:
            if isinstance(switch, OpticalSwitch):
                switch.launch(self.controllers)
        for controller in self.controllers:
            controller.start()
        with openvswitch.one_transaction():
            for switch in self.switches:
                switch.start(self.controllers)
        for switch in self.switches:
            if switch not in ours and hasattr(switch, "batchStartup"):
                switch.batchStartup([switch])  # what it has put off, as Mininet would
        self.hears = True

    def stop(self) -> None:
        """Stop everything; go on where one thing fails, and raise that at the end.

        Most links go with the namespaces of hosts, which the kernel takes away together, while
        bridges are deleted.
        """
        nodes = (*self.hosts, *self.controllers, *self.switches)
        ours = [switch for switch in self.switches if isinstance(switch, ClassicalSwitch)]
        links = [each for link in self.links for each in (link, *channels_of(link))]
        ends = [(link.intf1, link.intf2) for link in links]
        here = [[str(end) for end in pair if isinstance(end.node, Switch)] for pair in ends]
        going = {name for names in here for name in names} | runtime.current().management
        between = [name for names in here if len(names) == 2 for name in names]
        with ExitStack() as steps:  # from the last to the first
            steps.callback(interfaces.await_end, going)
            steps.callback(interfaces.delete, *between)
            for node in nodes:
                steps.callback(node.terminate)
            for switch in self.switches:
                if switch not in ours:
                    steps.callback(switch.stop)
            steps.callback(ClassicalSwitch.batchShutdown, ours)
            for node in nodes:
                if isinstance(node, ShellWatcher) and node.inNamespace and not node.privateDirs:
                    steps.callback(node.hang_up)
            for controller in self.controllers:
                steps.callback(controller.stop)
            if self.terms:
                steps.callback(self.stopXterms)
