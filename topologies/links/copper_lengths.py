"""How long copper is: as the shortest way along the fibres between the same places.

    alice ===== 20 km ===== q1 ===== 30 km ===== q2 === bob        fibres
    alice ------ 20 km ---- s1, which is at q1                     copper

A classical switch is where the farthest of its nodes is nearest. Whatever goes by way of it then
takes at least as long as light does between the same two nodes.
"""

from collections import defaultdict
from math import inf
from typing import Any

from mininet.topo import Topo

from programs.shortest_paths import Distances, shortest
from topologies.links.copper_link import CopperLink
from topologies.links.fiber import FiberLink
from wire.parameters.fiber import FiberOptics

ROUNDING = 1e-9  # more than sums of lengths are off by


def assign_copper_lengths(
    topo: Topo, copper_km: float | None = None, copper_mbps: float | None = None
) -> None:
    """Give copper of no length one: this, or that of the fibres between its places; and a rate.

    Links of other classes are left as they are, and without `copper_km` so are lengths that
    somebody has named, without `copper_mbps` rates.
    """
    fibers, copper = fibers_of(topo), copper_of(topo)
    places = places_of(topo, fibers, copper)
    # Those of an earlier call, which do not hold any more if fibres have changed.
    beside_fibers: set[int] = vars(topo).setdefault("copper_beside_fibers", set())
    reached: dict[str, dict[str, float]] = {}  # from the places of classical switches
    for one, other, info in copper:
        info["cls"] = CopperLink
        if copper_mbps is not None:
            info["mbps"] = copper_mbps
        if copper_km is not None:
            info["length_km"] = copper_km
        elif "length_km" not in info or id(info) in beside_fibers:
            beside_fibers.add(id(info))
            far, near = (other, one) if other in fibers else (one, other)  # s1 has no fibres
            if places[near] not in reached:
                reached[places[near]] = shortest(fibers, places[near])
            info["length_km"] = reached[places[near]].get(places[far], 0.0)


def fibers_of(topo: Topo) -> Distances:
    """Return the length (km) of the shortest fibre between neighbours."""
    distances: defaultdict[str, dict[str, float]] = defaultdict(dict)
    for one, other, info in topo.links(withInfo=True):
        if info.get("cls") is FiberLink:
            length_km = float(info.get("length_km", FiberOptics().length_km))
            for near, far in ((one, other), (other, one)):
                distances[near][far] = min(length_km, distances[near].get(far, inf))
    return dict(distances)


def copper_of(topo: Topo) -> list[tuple[str, str, dict[str, Any]]]:
    """Return the links that are plain, or of copper; each with what can be changed of it."""
    links: list[tuple[str, str, dict[str, Any]]] = topo.links(withInfo=True)
    return [link for link in links if link[2].get("cls") in (None, CopperLink)]


def places_of(
    topo: Topo, fibers: Distances, copper: list[tuple[str, str, dict[str, Any]]]
) -> dict[str, str]:
    """Return the node of the fibres at which each node is; its own name if it is at none."""
    places = {name: name for name in topo.nodes()}
    for switch in topo.switches():
        if switch not in fibers:
            ends = ((one, other) for one, other, _ in copper if switch in (one, other))
            near = {other if one == switch else one for one, other in ends} & fibers.keys()
            places[switch] = centre(fibers, sorted(near)) or switch
    for one, other, _info in copper:  # what has no light is where its switch is
        for node, beside in ((one, other), (other, one)):
            if node not in fibers and not topo.isSwitch(node):
                places[node] = places[beside]
    return places


def centre(fibers: Distances, nodes: list[str]) -> str | None:
    """Return the node from which the farthest of these is nearest, None if there are none.

    Few need be looked at: from each it is known how far the others have to go at least, to itself
    and, less the way to it, to the farthest.
    """
    if not nodes:
        return None
    candidates = set(nodes)
    farthest: dict[str, float] = {}  # of those that were looked at
    least = dict.fromkeys(sorted(fibers), 0.0)  # that it can be, of the others
    while least:
        place = min(least, key=least.__getitem__)
        if least.pop(place) > min(farthest.values(), default=inf):
            break
        reached = shortest(fibers, place)
        farthest[place] = max(reached.get(node, inf) for node in nodes)
        for other in least.keys() & reached.keys():
            way = reached[other]
            bound = max(farthest[place] - way, way if place in candidates else 0.0)
            least[other] = max(least[other], bound * (1 - ROUNDING))
    return min(sorted(farthest), key=farthest.__getitem__)
