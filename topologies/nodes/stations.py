"""Where hosts are on copper, as the controller is told; which switches carry copper alone."""

from mininet.node import Host, Node

from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.nodes.optical_switch import OpticalSwitch
from wire.config import Station


def is_copper_switch(node: Node) -> bool:
    """Return whether a node is a switch of copper, whatever its name; a quantum switch is not."""
    return isinstance(node, ClassicalSwitch) and not isinstance(node, OpticalSwitch)


def stations_of(host: Host) -> list[Station]:
    """Return where a host is on copper at classical switches."""
    address, mac = str(host.params["ip"]).partition("/")[0], host.params.get("mac")
    ends = [
        (interface, end)
        for interface in host.intfList()
        if interface.link is not None
        for end in (interface.link.intf1, interface.link.intf2)
        if is_copper_switch(end.node)
    ]
    return [
        Station(int(end.node.dpid, 16), end.node.ports[end], mac or interface.updateMAC(), address)
        for interface, end in ends
    ]
