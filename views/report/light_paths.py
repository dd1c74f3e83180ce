"""The light paths of a run: cross-connects that opened, joined by fibres."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from wire.config import QuantumSwitch
from wire.dispatcher_pb2 import Event
from wire.malformed import MalformedPacket
from wire.parameters.fiber import Fiber, FiberEnd
from wire.parameters.switch import INNER_PORTS, inner_port
from wire.results.run_result import NetworkFacts

_OUTCOME = re.compile(r"(?:Phi|Psi)[+-]=(\d+)")


@dataclass(frozen=True)
class Hop:
    """A fibre, or a way through a switch."""

    name: str
    loss_db: float
    ends: tuple[str, str] = ("", "")  # nodes, of a fibre


@dataclass(frozen=True)
class LightPath:
    """A way for light by fibres, from a host's port or a part of a switch to another such."""

    begin: str
    end: str
    hops: tuple[Hop, ...]

    @property
    def loss_db(self) -> float:
        return sum(hop.loss_db for hop in self.hops)


def light_paths(network: NetworkFacts, events: Iterable[Event]) -> list[LightPath]:
    """Return every path that stood at any time, in the order in which they did."""
    plant = _Plant(network)
    paths: dict[LightPath, None] = {}
    connections: dict[FiberEnd, str] = {}
    paths_shown: set[frozenset[tuple[FiberEnd, str]]] = set()  # a run may open the same path often
    for event in events:
        if event.kind == "open":
            in_port, out_port = _ports(event.detail)
            connections[FiberEnd(event.node, in_port)] = out_port
            connected = frozenset(connections.items())
            if connected not in paths_shown:
                paths_shown.add(connected)
                paths.update(dict.fromkeys(plant.paths(connections)))
        elif event.kind == "close":
            connections.pop(FiberEnd(event.node, event.port), None)
    return list(paths)


def _ports(detail: str) -> tuple[str, str]:
    """Return the ports of "2 -> 3 ..."; raise MalformedPacket for another detail."""
    match detail.split():
        case [in_port, "->", out_port, *_]:
            return in_port, out_port
    raise MalformedPacket(f"a cross-connect from nowhere: {detail!r}")


class _Plant:
    """Fibres by their ends, switches by their names."""

    def __init__(self, network: NetworkFacts) -> None:
        self._fibers: dict[FiberEnd, tuple[Fiber, FiberEnd]] = {}
        for fiber in network.fibers:
            self._fibers |= {fiber.a: (fiber, fiber.b), fiber.b: (fiber, fiber.a)}
        self._switches = {switch.name: switch for switch in network.switches}

    def paths(self, connections: dict[FiberEnd, str]) -> Iterator[LightPath]:
        for begin in self._fibers:
            if begin.node not in self._switches:
                path = self._follow(begin.port, begin, connections)
                if path is not None:
                    yield path
        for begin, out_port in connections.items():
            if name := part_at(begin):
                path = self._follow(name, FiberEnd(begin.node, out_port), connections)
                if path is not None:
                    yield path

    def _follow(
        self, name: str, place: FiberEnd, connections: dict[FiberEnd, str]
    ) -> LightPath | None:
        hops: list[Hop] = []
        seen = set[FiberEnd]()
        while place in self._fibers and place not in seen:
            seen.add(place)
            fiber, far = self._fibers[place]
            hops.append(Hop(fiber_name(fiber), fiber.loss_db, (place.node, far.node)))
            if far.node not in self._switches:
                return LightPath(name, far.port, tuple(hops))
            if far not in connections:
                return None
            switch, out_port = self._switches[far.node], connections[far]
            hops.append(
                Hop(f"{far.node} {far.port}→{out_port}", _switch_loss_db(switch, far, out_port))
            )
            place = FiberEnd(far.node, out_port)
            if part := part_at(place):
                return LightPath(name, part, tuple(hops))
        return None


def part_at(place: FiberEnd) -> str:
    """Return the name of the part of a switch that its port leads to, empty for others."""
    number = int(place.port) if place.port.isdigit() else 0
    return inner_port(number).node(place.node) if number in INNER_PORTS else ""


def fiber_name(fiber: Fiber) -> str:
    ends = [
        end.port if end.port.startswith(end.node) else f"{end.node}:{end.port}"
        for end in (fiber.a, fiber.b)
    ]
    return " – ".join(ends)  # noqa: RUF001 (from one end to the other)


def _switch_loss_db(switch: QuantumSwitch, place: FiberEnd, out_port: str) -> float:
    for path in switch.paths:
        if (str(path.in_port), str(path.out_port)) == (place.port, out_port):
            return path.insertion_loss_db
    return switch.insertion_loss_db


def photons_by_port(events: Iterable[Event]) -> dict[str, tuple[int, int]]:
    counts: dict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for event in events:
        if event.kind == "arrive" and event.port:
            inside = part_at(FiberEnd(event.node, event.port))  # there the node is the part
            place = event.node if inside else event.port
            photons, lost = counts[place]
            counts[place] = (photons + event.photons, lost + event.lost)
    return dict(counts)


def without_outcome(event: Event) -> int:
    """Return of how many pairs a Bell measurement says nothing, as one or both halves were lost.

    `lost` of the event is of one half alone.
    """
    return int(event.photons) - sum(map(int, _OUTCOME.findall(event.detail)))
