"""Obstacles to light: the elements that are cut or stuck, by name."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from controller_apps.light.optics import Optics, SwitchOptics, SwitchPort
from controller_apps.light.paths import Hop, Network
from controller_apps.light.routing import Leg, Limits, route


class Obstacle(NamedTuple):
    """An element that is cut, stuck or away."""

    text: str
    address: str = ""  # of the host whose fibre it is, if it is one's
    secret: bool = False  # whether it is for who runs the network alone


def text_of(obstacles: Sequence[Obstacle], limit: int) -> str:
    """Return the obstacles in at most `limit` characters, for a host that asked for light."""
    texts = [obstacle.text for obstacle in obstacles if not obstacle.secret]
    shown = len(texts)
    while shown and len(text := _listed(texts, shown)) > limit:
        shown -= 1
    return text if shown else ""


def _listed(texts: Sequence[str], shown: int) -> str:
    more = [f"{len(texts) - shown} more"] if shown < len(texts) else []
    return "; ".join([*texts[:shown], *more])


def obstacles(network: Network, legs: Sequence[Leg]) -> list[Obstacle]:
    """Return what is cut, stuck or away on a route that there would be if nothing were.

    Empty if there would be none either: then something is missing, and not broken.
    """
    paths = route(mended(network), legs, Limits()) or ()
    return on_the_way(network, [hop for path in paths for hop in path.hops])


def on_the_way(network: Network, hops: Iterable[Hop]) -> list[Obstacle]:
    return list(dict.fromkeys(obstacle for hop in hops for obstacle in _of_hop(network, hop)))


def mended(network: Network) -> Network:
    """Return the network with every switch there, fibre whole and cross-connect free."""
    free = {
        dpid: SwitchOptics(optics.others, optics.paths)
        for dpid, optics in network.optics.switches.items()
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
        # An eavesdropper there need not hear that it was noticed.
        text = f"the policy closes the fibres between {ends[0]} and {ends[1]}"
        yield Obstacle(text, secret=True)
    reported = network.optics.switches.get(hop.dpid, SwitchOptics())
    stuck = {
        *((hop.in_port, to) for to in [reported.stuck_from.get(hop.in_port)] if to is not None),
        *(
            (start, hop.out_port)
            for start in [reported.stuck_to.get(hop.out_port)]
            if start is not None
        ),
    }
    for start, end in sorted(stuck - {(hop.in_port, hop.out_port)}):
        yield Obstacle(f"cross-connect {start} -> {end} of {switch} is stuck")


def _fiber(network: Network, at: SwitchPort) -> Obstacle:
    """Return which fibre is cut, the same words from both its ends."""
    switch = network.name_of(at.dpid)
    if at in network.hosts:
        host = network.hosts[at]
        return Obstacle(f"fibre {host.host}-{switch} ({host.name}) is cut", host.address)
    ends = sorted((at, network.broken.get(at, at)))
    between = {end.dpid for end in ends}
    names = "-".join(network.name_of(end.dpid) for end in dict.fromkeys(ends))
    alike = [each for each in (network.broken | network.links).items() if _join(each, between)]
    ports = " and ".join(str(end.port) for end in ends)
    return Obstacle(f"fibre {names}{f' (ports {ports})' if len(alike) > 2 else ''} is cut")


def _join(fiber: tuple[SwitchPort, SwitchPort], switches: set[int]) -> bool:
    return {end.dpid for end in fiber} == switches
