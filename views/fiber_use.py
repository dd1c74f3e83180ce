"""The use of every fibre: when a cross-connect let light through it, in each direction."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from wire.dispatcher_pb2 import Event
from wire.parameters.fiber import FiberEnd
from wire.results.run_result import NetworkFacts

Interval = tuple[int, int]  # ns, on the clock of the captures
Use = dict[str, list[Interval]]  # by what a person calls the fibre and the direction


def fiber_use(network: NetworkFacts, events: Iterable[Event]) -> Use:
    """Return when each fibre was in use, those that never were with no intervals.

    A fibre is in use in a direction as long as the switch that it leads to, or comes from, has a
    cross-connect for its port. Intervals still open at the end last until the last event.
    """
    switches = {switch.name for switch in network.switches}
    at: dict[tuple[FiberEnd, bool], str] = {}  # a switch's port, and whether light comes in by it
    names: dict[str, None] = {}
    for fiber in network.fibers:
        for begin, end in ((fiber.a, fiber.b), (fiber.b, fiber.a)):
            name = f"{_name(begin, switches)} → {_name(end, switches)}"
            names[name] = None
            if begin.node in switches:
                at[begin, False] = name
            else:
                at[end, True] = name
    use: defaultdict[str, list[Interval]] = defaultdict(list)
    standing: dict[FiberEnd, tuple[int, str]] = {}  # by in-port: since when, and the out-port
    last = 0
    for event in events:
        last = max(last, event.time_ns)
        if event.kind == "open":
            in_port, _arrow, out_port = event.detail.split()[:3]
            _ended(use, at, standing, FiberEnd(event.node, in_port), event.time_ns)
            standing[FiberEnd(event.node, in_port)] = event.time_ns, out_port
        elif event.kind == "close":
            _ended(use, at, standing, FiberEnd(event.node, event.port), event.time_ns)
    for place in list(standing):
        _ended(use, at, standing, place, last)
    return {name: sorted(use[name]) for name in names}


def shares(use: Use, begin_ns: int, end_ns: int) -> dict[str, float]:
    span = max(end_ns - begin_ns, 1)
    return {
        name: sum(max(0, min(end, end_ns) - max(begin, begin_ns)) for begin, end in intervals)
        / span
        for name, intervals in use.items()
    }


def _ended(
    use: defaultdict[str, list[Interval]],
    at: Mapping[tuple[FiberEnd, bool], str],
    standing: dict[FiberEnd, tuple[int, str]],
    place: FiberEnd,
    end_ns: int,
) -> None:
    if place not in standing:
        return
    begin_ns, out_port = standing.pop(place)
    for key in ((place, True), (FiberEnd(place.node, out_port), False)):
        if key in at:
            use[at[key]].append((begin_ns, end_ns))


def _name(end: FiberEnd, switches: set[str]) -> str:
    return f"{end.node}:{end.port}" if end.node in switches else end.port


def span_of(use: Use) -> Interval:
    """Return the first and the last moment at which a fibre was in use, 0 and 0 if none was."""
    times: Sequence[int] = [
        time for intervals in use.values() for pair in intervals for time in pair
    ]
    return (min(times), max(times)) if times else (0, 0)
