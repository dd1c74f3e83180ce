"""Where hosts are on copper, as the controller is told."""

from mininet.node import Host

from topologies.nodes.classical_switch import ClassicalSwitch
from topologies.nodes.optical_switch import OpticalSwitch
from wire.config import Station


def stations_of(host: Host) -> list[Station]:
    """Return where a host is on copper at classical switches."""
    address, mac = str(host.params["ip"]).partition("/")[0], host.params.get("mac")
    ends = [
        (interface, end)
        for interface in host.intfList()
        if interface.link is not None
        for end in (interface.link.intf1, interface.link.intf2)
        if isinstance(end.node, ClassicalSwitch) and not isinstance(end.node, OpticalSwitch)
    ]
    return [
        Station(int(end.node.dpid, 16), end.node.ports[end], mac or interface.updateMAC(), address)
        for interface, end in ends
    ]
