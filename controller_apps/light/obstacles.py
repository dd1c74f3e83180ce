"""What stands in the way of light: the elements that are cut or stuck, by name."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from controller_apps.light.optics import Optics, SwitchOptics, SwitchPort
from controller_apps.light.paths import Hop, Network
from controller_apps.light.routing import Leg, Limits, route


class Obstacle(NamedTuple):
    """An element that is cut, stuck or away."""

    text: str
    address: str = ""  # of the host whose fibre it is, if it is one's


def obstacles(network: Network, legs: Sequence[Leg]) -> list[Obstacle]:
    """Return what is cut, stuck or away on a route that there would be if nothing were.

    Empty if there would be none either: then something is missing, and not broken.
    """
    paths = route(_mended(network), legs, Limits()) or ()
    found = [each for path in paths for hop in path.hops for each in _of_hop(network, hop)]
    return list(dict.fromkeys(found))


def _mended(network: Network) -> Network:
    """Return the network with every switch there, fibre whole and cross-connect free."""
    free = {
        dpid: SwitchOptics(told.others, told.paths)
        for dpid, told in network.optics.switches.items()
    }
    links = network.broken | network.links
    there = network.connected | network.names.keys()
    optics = Optics(switches=free)
    return replace(
        network, connected=there, links=links, cut=set(), optics=optics, closed=frozenset()
    )


def _of_hop(network: Network, hop: Hop) -> Iterator[Obstacle]:
    into, out = SwitchPort(hop.dpid, hop.in_port), SwitchPort(hop.dpid, hop.out_port)
    switch = network.name_of(hop.dpid)
    if hop.dpid not in network.connected:
        yield Obstacle(f"{switch} is not connected to the controller")
    yield from (_fiber(network, at) for at in (into, out) if at in network.cut)
    if network.is_closed(out):
        ends = sorted((switch, network.name_of(network.links[out].dpid)))
        yield Obstacle(f"the policy closes the fibres between {ends[0]} and {ends[1]}")
    told = network.optics.switches.get(hop.dpid, SwitchOptics())
    stuck = {
        *((hop.in_port, to) for to in [told.stuck_from.get(hop.in_port)] if to is not None),
        *(
            (start, hop.out_port)
            for start in [told.stuck_to.get(hop.out_port)]
            if start is not None
        ),
    }
    for start, end in sorted(stuck - {(hop.in_port, hop.out_port)}):
        yield Obstacle(f"{switch} is stuck: it connects port {start} to port {end}")


def _fiber(network: Network, at: SwitchPort) -> Obstacle:
    """Return which fibre is cut, the same words from both its ends."""
    if at in network.hosts:
        host = network.hosts[at]
        return Obstacle(f"the fibre {host.name} at {network.name_of(at.dpid)} is cut", host.address)
    ends = sorted((at, network.broken.get(at, at)))
    between = " to ".join(
        f"{network.name_of(end.dpid)} port {end.port}" for end in dict.fromkeys(ends)
    )
    return Obstacle(f"the fibre {between} is cut")
