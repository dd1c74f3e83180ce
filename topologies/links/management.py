"""The management network: copper between the controller, in its namespace, and each switch.

    c0's namespace                       this machine's, where bridges and agents are
    c0-net ---- c0-s1 ================== s1-c0      198.18.1.0/30
    (bridge) `- c0-q1 ================== q1-c0      198.18.2.0/30

OpenFlow goes this way, and in it what the controller says to node agents. Mininet's verbs work on
it: `link c0 q1 down` cuts q1 off from its controller. q1 keeps its copper to s1 as well.
"""

from collections.abc import Mapping
from ipaddress import IPv4Address
from typing import Any

from mininet.node import Node

from programs.shortest_paths import shortest
from topologies.links.copper_link import CopperLink, delay_s, length_km
from topologies.system.kernel.interfaces import WITHOUT_SLOW_START, network_of, switch_ipv6_off
from topologies.system.processes.commands import ip
from topologies.system.runs.runtime import Runtime
from wire.network_time import SteppedTime

BRIDGE_ADDRESS = "02:71:6d:6e:63:30"
NETWORK = IPv4Address("198.18.0.0")  # /15, of RFC 2544, which no host on the Internet has


def bridge_of(controller: str) -> str:
    return f"{controller}-net"


def lay_management(
    controller: Node, switches: Mapping[str, Node], network: Runtime
) -> dict[str, str]:
    """Join a controller with switches; return its address for each of them, by name."""
    bridge = bridge_of(controller.name)
    inside = [
        "link set lo up",
        f"link add {bridge} address {BRIDGE_ADDRESS} type bridge",
        f"link set {bridge} up",
    ]
    outside = []
    lengths = lengths_to(switches, network)
    addresses = {}
    for number, (name, switch) in enumerate(switches.items(), 1):
        ours, theirs = (str(NETWORK + 256 * number + host) for host in (1, 2))
        length_km, loss = lengths[name], network.settings.control_loss
        near, far = _interfaces(controller, switch, theirs, length_km, loss)
        inside += [
            f"link set {near} master {bridge}",
            f"addr add {ours}/30 dev {bridge}",
            f"neigh replace {theirs} lladdr {far.updateMAC()} dev {bridge} nud permanent",
        ]
        switch_ipv6_off(switch, str(far))
        outside.append(f"neigh replace {ours} lladdr {BRIDGE_ADDRESS} dev {far} nud permanent")
        if isinstance(network.time, SteppedTime):
            subnet = f"{NETWORK + 256 * number}/30"
            for source, device, commands in ((ours, bridge, inside), (theirs, far, outside)):
                route = f"route replace {subnet} dev {device} src {source}"
                commands.append(f"{route} {WITHOUT_SLOW_START}")
        network.management.add(str(far))
        addresses[name] = ours
    with network_of(controller):
        ip(inside)
    ip(outside)
    return addresses


def _interfaces(
    controller: Node, switch: Node, address: str, length_km: float, loss: float
) -> tuple[Any, Any]:
    """Lay copper; return its ends, of which the switch's has the address, so is no port."""
    link = CopperLink(
        controller,
        switch,
        length_km=length_km,
        loss=loss,
        intfName1=f"{controller.name}-{switch.name}",
        intfName2=f"{switch.name}-{controller.name}",
        params2={"ip": f"{address}/30"},
    )
    return link.intf1, link.intf2


def lengths_to(switches: Mapping[str, Node], network: Runtime) -> dict[str, float]:
    """Return how long the copper to each switch is: the controller is at the first classical one.

    That is as long as the way along the copper between the switches, which is that of the fibres.
    """
    if network.settings.control_km is not None:
        return dict.fromkeys(switches, network.settings.control_km)
    distances: dict[str, dict[str, float]] = {}
    for link, seconds in network.copper.items():
        one, other = link
        distances.setdefault(one, {})[other] = distances.setdefault(other, {})[one] = seconds
    place = next((name for name in switches if name not in network.switches), "")
    reached = shortest(distances, place)
    return {name: length_km(reached.get(name, delay_s(0.0))) for name in switches}
