"""Light paths that are to go by way of one fibre between two switches, which is to be watched.

start ---> near | fibre | far ---> end        the cheapest of both parts, of either direction
"""

from collections.abc import Container, Iterator

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Network, switches
from controller_apps.light.routing import Leg, LightPath, Limits, bounds_to, cheapest_path

Switches = frozenset[str]  # two, by their names


def path_over(network: Network, leg: Leg, over: Switches, limits: Limits) -> LightPath | None:
    """Return a path that crosses a fibre between these switches; None if none is found.

    One part is the cheapest, the other the cheapest round that: where only two parts that are both
    longer keep out of each other's way, none is found.
    """
    limits, budget_mdb = limits._replace(loss_budget_mdb=None), limits.loss_budget_mdb
    for near, far in _fibers(network, leg, over):
        legs = Leg(leg.start, near), Leg(far, leg.end)
        paths = [
            _joined(network, *parts, near, far)
            for first in (0, 1)
            if (parts := _parts(network, legs, first, limits)) is not None
        ]
        path = min(paths, key=lambda each: each.loss_mdb, default=None)
        if path is not None and (budget_mdb is None or path.loss_mdb <= budget_mdb):
            return path
    return None


def _parts(
    network: Network, legs: tuple[Leg, Leg], first: int, limits: Limits
) -> tuple[LightPath, LightPath] | None:
    one, other = legs[first], legs[1 - first]
    ends = {other.start.dpid, other.end.dpid}
    cheapest = cheapest_path(network, one, _around(limits, ends))
    if cheapest is None:
        return None
    passed = set(switches(cheapest.hops))
    beside = cheapest_path(network, other, _around(limits, passed))
    if beside is None:
        return None
    return (beside, cheapest) if first else (cheapest, beside)


def _around(limits: Limits, passed: Container[int]) -> Limits:
    """Return the limits of the other part of a path, which passes each switch once."""
    return limits._replace(blocked=lambda way: way.dpid in passed or limits.blocked(way))


def _fibers(network: Network, leg: Leg, over: Switches) -> Iterator[tuple[SwitchPort, SwitchPort]]:
    """Yield the fibres in the order of what light loses at least on the way over each."""
    after = bounds_to(leg.end, network)
    costs = []
    for dpid, name in network.names.items():
        for near, far in network.links_from(dpid) if name in over else ():
            before = bounds_to(near, network)
            ends = {name, network.name_of(far.dpid)}
            if ends == over and leg.start.dpid in before and far.dpid in after:
                lost_mdb = before[leg.start.dpid][0] + after[far.dpid][0]
                costs.append((lost_mdb, near, far))
    for _lost_mdb, near, far in sorted(costs):
        yield near, far


def _joined(
    network: Network, before: LightPath, after: LightPath, near: SwitchPort, far: SwitchPort
) -> LightPath:
    """Return two parts as one path; each counts the fibre between them as one to a host."""
    optics = network.optics
    counted = sum(optics.fiber_loss_mdb(at, None) for at in (near, far))
    loss_mdb = before.loss_mdb + after.loss_mdb - counted + optics.fiber_loss_mdb(near, far)
    return LightPath(before.hops + after.hops, loss_mdb, before.rotation ^ after.rotation)
