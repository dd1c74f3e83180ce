"""Light paths through the optical network: the cheapest by loss, within what is asked for.

The search is A* (Hart, Nilsson and Raphael, 1968) over the ports that light comes in by, because
what a switch does to light depends on both its ports. Its estimates are lower bounds.

Lower bounds of what light loses from each switch to a port, for the search of light paths (A*).

They hold whatever is taken, cut or stuck: what light may lose at least, and over how many switches.
Where a switch loses less by one path than by others, the least counts for all of its paths.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from heapq import heappop, heappush
from itertools import permutations
from operator import xor
from typing import NamedTuple

from controller_apps.light.optics import UNKNOWN, SwitchPort
from controller_apps.light.paths import Bound, Direction, Hop, Network, directions
from wire.metadata.vocabulary import Reason


def bounds_to(end: SwitchPort, network: Network) -> dict[int, Bound]:
    """Return the bound from each switch, from where light comes in, to what is behind a port.

    A switch that is not in it cannot be come from.
    """
    return network.bounds(end, partial(_bounds, end, network))


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
    bounds: dict[int, Bound] = {}
    queue = [(first, 1, end.dpid)]
    while queue:
        loss_mdb, length, dpid = heappop(queue)
        if dpid in bounds:
            continue
        bounds[dpid] = loss_mdb, length
        for before, lost in into[dpid]:
            if before not in bounds:
                heappush(queue, (loss_mdb + lost, length + 1, before))
    return bounds


def _nothing(_way: Direction) -> bool:
    return False


class Limits(NamedTuple):
    blocked: Callable[[Direction], bool] = _nothing
    frequency_mhz: int | None = None  # None: whatever the ports are tuned to
    loss_budget_mdb: int | None = None
    rotation: int | None = None  # wire.outcomes.Pauli that the path applies; None: any


@dataclass(frozen=True)
class LightPath:
    """The hops from one host port to another, and what light undergoes on them."""

    hops: tuple[Hop, ...]
    loss_mdb: int
    rotation: int

    @property
    def leg(self) -> "Leg":
        first, last = self.hops[0], self.hops[-1]
        start, end = SwitchPort(first.dpid, first.in_port), SwitchPort(last.dpid, last.out_port)
        return Leg(start, end)


class Leg(NamedTuple):
    """The ends of a path: light comes in at start and goes out at end."""

    start: SwitchPort
    end: SwitchPort


class _Reached(NamedTuple):
    """A place that light can come to, in order of preference."""

    least_mdb: int  # from the start by way of it to the end
    least_length: int
    hops: tuple[Hop, ...]
    loss_mdb: int  # until here
    at: SwitchPort
    rotation: int


def rotation_of(paths: Iterable[LightPath]) -> int:
    """Return what all paths together do to a pair: Pauli operators commute but for the sign."""
    return reduce(xor, (path.rotation for path in paths), 0)


def cheapest_path(network: Network, leg: Leg, limits: Limits) -> LightPath | None:
    """Return the path of least loss, then of fewest hops; None if there is none.

    A path passes each switch once. The best of a network in which all is free is searched once:
    where others have nothing of it, it is the best.
    """
    if not _can_begin(network, leg, limits):
        return None
    free = limits._replace(blocked=_nothing)
    key = _search, leg, free
    best = network.if_all_were_free(key, partial(_search, network, leg, free))
    if best is None or not any(map(limits.blocked, directions(best.hops)[1:-1])):
        return best
    return _search(network, leg, limits)


def _search(network: Network, leg: Leg, limits: Limits) -> LightPath | None:
    """Search from the start, whose port is free, as is that of the end."""
    bounds = bounds_to(leg.end, network)
    if leg.start.dpid not in bounds:
        return None
    least_mdb, least_length = bounds[leg.start.dpid]
    first_mdb = network.optics.fiber_loss_mdb(leg.start, None)
    queue = [_Reached(first_mdb + least_mdb, least_length, (), first_mdb, leg.start, 0)]
    settled: set[tuple[SwitchPort, int]] = set()
    while queue:
        reached = heappop(queue)
        key = reached.at, reached.rotation if limits.rotation is not None else 0
        if key in settled:
            continue
        settled.add(key)
        if reached.at == leg.end:
            if limits.rotation in (None, reached.rotation):
                return LightPath(reached.hops, reached.loss_mdb, reached.rotation)
            continue
        for further in _further(network, reached, leg.end, limits, bounds):
            if limits.loss_budget_mdb is None or further.least_mdb <= limits.loss_budget_mdb:
                heappush(queue, further)
    return None


def _can_begin(network: Network, leg: Leg, limits: Limits) -> bool:
    start, end = leg
    return (
        start != end
        and {start.dpid, end.dpid} <= network.connected
        and not network.cut & {start, end}
        and _is_free(network, start, True, limits)
        and _is_free(network, end, False, limits)
    )


def _is_free(network: Network, at: SwitchPort, inward: bool, limits: Limits) -> bool:
    frequency_mhz = limits.frequency_mhz
    if frequency_mhz is not None and not network.optics.can_carry(at, frequency_mhz):
        return False
    return not limits.blocked(Direction(at.dpid, at.port, inward))


def _further(
    network: Network,
    reached: _Reached,
    end: SwitchPort,
    limits: Limits,
    bounds: Mapping[int, Bound],
) -> Iterator[_Reached]:
    """Yield where light can come to next: the end, or the ports of the next switches."""
    dpid = reached.at.dpid
    ways: list[tuple[SwitchPort, SwitchPort | None]] = []
    if dpid == end.dpid:
        ways = [(end, None)]
    else:
        passed = {hop.dpid for hop in reached.hops}
        ways = [
            (near, far)
            for near, far in network.links_from(dpid)
            if far.dpid not in passed
            and far.dpid in bounds
            and _is_free(network, near, False, limits)
            and _is_free(network, far, True, limits)
        ]
    for near, far in ways:
        path = network.optics.path(dpid, reached.at.port, near.port)
        if path is None:
            continue
        lost = path.loss_mdb + network.optics.fiber_loss_mdb(near, far)
        loss_mdb = reached.loss_mdb + lost
        left_mdb, left_through = bounds[far.dpid] if far is not None else (0, 0)
        yield _Reached(
            loss_mdb + left_mdb,
            len(reached.hops) + 1 + left_through,
            (*reached.hops, Hop(dpid, reached.at.port, near.port)),
            loss_mdb,
            far or near,
            reached.rotation ^ path.rotation,
        )


def route(
    network: Network,
    legs: Sequence[Leg],
    limits: Limits,
    beside: Iterable[LightPath] = (),
    rotations: Sequence[int] | None = None,
) -> tuple[LightPath, ...] | None:
    """Return a path for each leg, none of which takes what another or one beside needs.

    `rotations` are those that the paths must apply, None for any. That of a network in which all
    is free is searched once, and taken where others have nothing of it.
    """
    if not beside and rotations is None:
        free = limits._replace(blocked=_nothing)
        key = _route, tuple(legs), free
        paths = network.if_all_were_free(key, partial(_route, network, legs, free))
        ways = directions(hop for path in paths or () for hop in path.hops)
        if paths and not any(map(limits.blocked, ways)):
            return paths
    return _route(network, legs, limits, beside, rotations)


def _route(
    network: Network,
    legs: Sequence[Leg],
    limits: Limits,
    beside: Iterable[LightPath] = (),
    rotations: Sequence[int] | None = None,
) -> tuple[LightPath, ...] | None:
    """Search the paths of legs one after the other.

    The cheapest path of an early leg may leave a later one without any, so that other orders are
    tried as well; not if a leg has no path even alone.
    """
    turns: Sequence[int | None] = rotations or [None] * len(legs)
    alone: set[int] = set()  # legs that have a path if no other does

    def path_of(number: int, paths: Iterable[LightPath]) -> LightPath | None:
        own_limits = limits._replace(rotation=turns[number])
        return cheapest_path(network, legs[number], _beside((*beside, *paths), own_limits))

    for order in permutations(range(len(legs))):
        routed: dict[int, LightPath] = {}
        for number in order:
            path = path_of(number, routed.values())
            if path is None:
                if number not in alone and (not routed or path_of(number, ()) is None):
                    return None
                alone.add(number)
                break
            routed[number] = path
        else:
            return tuple(routed[number] for number in range(len(legs)))
    return None


def _beside(paths: Iterable[LightPath], limits: Limits) -> Limits:
    directions_used = {direction for path in paths for direction in directions(path.hops)}
    if not directions_used:
        return limits
    return limits._replace(blocked=lambda way: way in directions_used or limits.blocked(way))


def why_not(network: Network, legs: list[Leg], limits: Limits) -> Reason:
    """Return what stands in the way of a route: the first limit without which there is one."""
    key = _why_not, tuple(legs), limits._replace(blocked=Limits().blocked)
    return network.if_all_were_free(key, partial(_why_not, network, legs, limits))


def _why_not(network: Network, legs: list[Leg], limits: Limits) -> Reason:
    free = limits._replace(blocked=Limits().blocked)
    free_at_any_loss = free._replace(loss_budget_mdb=None)
    for reason, fewer in (
        (Reason.BUSY, free),
        (Reason.LOSS_TOO_HIGH, free_at_any_loss),
        (Reason.NO_WAVELENGTH, free_at_any_loss._replace(frequency_mhz=None)),
    ):
        if route(network, legs, fewer) is not None:
            return reason
    return Reason.NO_PATH
