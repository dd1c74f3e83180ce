"""Lower bounds of what light loses from each switch to a port, for the search of light paths (A*).

They hold whatever is taken, cut or stuck: what light may lose at least, and over how many switches.
Where a switch loses less by one path than by others, the least counts for all of its paths.
"""

from collections import defaultdict
from heapq import heappop, heappush

from controller_apps.light.optics import UNKNOWN, SwitchPort
from controller_apps.light.paths import Bound, Network

MAX_BOUNDS = 1024  # ports that are remembered


def bounds_to(end: SwitchPort, network: Network) -> dict[int, Bound]:
    """Return the bound from each switch, from where light comes in, to what is behind a port.

    A switch that is not in it cannot be come from.
    """
    known = network.until_it_changes()
    if end not in known:
        if len(known) >= MAX_BOUNDS:
            known.clear()
        known[end] = _bounds(end, network)
    return known[end]


def _bounds(end: SwitchPort, network: Network) -> dict[int, Bound]:
    """Search from the end backwards (Dijkstra), by switches."""
    optics = network.optics
    there = {end.dpid, *(at.dpid for at in network.links)}
    least = {dpid: optics.switches.get(dpid, UNKNOWN).least_loss_mdb for dpid in there}
    into: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    for near, far in network.links.items():
        lost = least[near.dpid] + optics.fiber_loss_mdb(near, far)
        into[far.dpid].append((near.dpid, lost))
    first = least[end.dpid] + optics.fiber_loss_mdb(end, None)
    found: dict[int, Bound] = {}
    queue = [(first, 1, end.dpid)]
    while queue:
        loss_mdb, length, dpid = heappop(queue)
        if dpid in found:
            continue
        found[dpid] = loss_mdb, length
        for before, lost in into[dpid]:
            if before not in found:
                heappush(queue, (loss_mdb + lost, length + 1, before))
    return found
