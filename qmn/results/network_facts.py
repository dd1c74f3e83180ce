"""The parts of a running network, for its result."""

from topologies.links.fiber import FiberLink
from topologies.networks.network import Network
from wire.results.network_facts import NetworkFacts


def network_facts(network: Network) -> NetworkFacts:
    """Return what a running network is made of."""
    runtime = network.runtime
    copper = [
        [link.intf1.node.name, link.intf1.name, link.intf2.node.name, link.intf2.name]
        for link in network.net.links
        if not isinstance(link, FiberLink)
    ]
    copper_ids = {name: int(network.net[name].dpid, 16) for name in network.copper_switches}
    return NetworkFacts(
        {host: address.partition("/")[0] for host, address in runtime.addresses.items()},
        runtime.source,
        list(runtime.fibers),
        list(runtime.switches.values()),
        copper,
        {name: (x, y) for name, (x, y) in getattr(network.net.topo, "positions", {}).items()},
        runtime.datapath_ids | copper_ids,
        network.copper_switches,
    )
