"""Maps from files: GraphML, and the JSON of the simulator SeQUeNCe."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import atan2, cos, degrees, hypot, isfinite, radians, sin
from pathlib import Path
from typing import Any

from topologies.catalogue.map_parts import BadMap, Map, Position, from_parts, great_circle_km

SEQUENCE_FIELDS = {
    "": {"nodes", "qconnections", "qchannels"},
    "nodes": {"name"},
    "qconnections": {"node1", "node2", "distance", "attenuation"},
    "qchannels": {"source", "destination", "distance", "attenuation"},
}
Link = tuple[str, str, float, float | None]  # two places, km, dB/km


def read_file(path: Path) -> Map:
    """Return the map of a file; raise BadMap, with its name, if it cannot be read."""
    import networkx  # loading it takes a moment: other maps do not wait for it

    try:
        if path.suffix == ".graphml":
            return _graphml(path, networkx.read_graphml(path))
        return _sequence(path, json.loads(path.read_text()))
    except OSError as error:
        raise BadMap(f"cannot read the map {path}: {error.strerror}") from error
    except RecursionError as error:
        raise BadMap(f"{path} is not a map: it is nested too deeply") from error
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        SyntaxError,
        TypeError,
        ValueError,
        networkx.NetworkXException,
    ) as error:
        if isinstance(error, BadMap):
            raise
        problem = " ".join(f"{type(error).__name__} {error}".split())
        raise BadMap(f"{path} is not a map of its kind: {problem}") from error


def _graphml(path: Path, graph: Any) -> Map:
    """Return the map of a GraphML file: names are labels, lengths `dist` (km), or great circles."""
    drawn = {
        node: position
        for node, info in graph.nodes(data=True)
        if (position := _position(path, node, info))
    }
    places = _filled(drawn, {node: set(graph.to_undirected(as_view=True)[node]) for node in graph})

    def length_km(one: str, other: str, info: Mapping[str, Any]) -> float:
        if "dist" in info:
            return float(info["dist"])
        if one not in places or other not in places:
            raise BadMap(
                f"{path}: {one} to {other} has no dist, in km, and no place that these are "
                "joined to has Longitude and Latitude"
            )
        return great_circle_km(places[one], places[other])

    links = ((u, v, length_km(u, v, info), None) for u, v, info in graph.edges(data=True))
    return from_parts(
        path.stem,
        [(n, str(info.get("label", n)), places.get(n)) for n, info in graph.nodes(data=True)],
        list(_once(links) if graph.is_directed() else links),
    )


def _position(path: Path, node: str, info: Mapping[str, Any]) -> Position | None:
    if "Longitude" not in info or "Latitude" not in info:
        return None
    position = float(info["Longitude"]), float(info["Latitude"])
    if not all(map(isfinite, position)):
        raise BadMap(f"{path}: {node} is at {position}: give degrees, or leave them out")
    return position


def _filled(
    positions: Mapping[str, Position], neighbors: Mapping[str, set[str]]
) -> dict[str, Position]:
    """Return positions with those of places that have none: in the middle of their neighbours.

    Places whose neighbours have none either come after these.
    """
    filled = dict(positions)
    while between := {
        node: _middle([filled[each] for each in sorted(others) if each in filled])
        for node, others in neighbors.items()
        if node not in filled and others & filled.keys()
    }:
        filled |= between
    return filled


def _middle(positions: Sequence[Position]) -> Position:
    """Return the middle of positions on a sphere: where the sum of their vectors points to."""
    east, north = zip(*(map(radians, position) for position in positions), strict=True)
    pairs = list(zip(east, north, strict=True))
    x = sum(cos(n) * cos(e) for e, n in pairs)
    y = sum(cos(n) * sin(e) for e, n in pairs)
    z = sum(sin(n) for _, n in pairs)
    return degrees(atan2(y, x)), degrees(atan2(z, hypot(x, y)))


def _once(links: Iterator[Link]) -> Iterator[Link]:
    """Yield each fibre once where a file names it in either direction."""
    unpaired: Counter[tuple[str, str]] = Counter()
    for link in links:
        one, other, *_ = link
        if unpaired[other, one]:
            unpaired[other, one] -= 1
            continue
        unpaired[one, other] += 1
        yield link


def _sequence(path: Path, content: Mapping[str, Any]) -> Map:
    """Return the map of SeQUeNCe's JSON: `distance` is in m, `attenuation` in dB/m.

    Ways are its qconnections and its qchannels, of which two may be one way.
    """
    channels = _links(path, content.get("qchannels", ()), "source", "destination")
    connections = _links(path, content.get("qconnections", ()), "node1", "node2")
    nodes = [(str(node["name"]), str(node["name"]), None) for node in content["nodes"]]
    return from_parts(path.stem, nodes, [*connections, *_once(channels)], _unused(content))


def _links(path: Path, entries: Any, one: str, other: str) -> Iterator[Link]:
    for entry in entries:
        ends = str(entry[one]), str(entry[other])
        if ends[0] == ends[1]:
            raise BadMap(f"{path}: a way from {ends[0]} to {ends[0]}: join two different nodes")
        yield *ends, float(entry["distance"]) / 1e3, float(entry["attenuation"]) * 1e3


def _unused(content: Mapping[str, Any]) -> tuple[str, ...]:
    unused = set(content) - SEQUENCE_FIELDS[""]
    for part, fields in SEQUENCE_FIELDS.items():
        for entry in content.get(part, ()):
            unused |= {f"{part}.{name}" for name in set(entry) - fields}
    return tuple(sorted(unused))
