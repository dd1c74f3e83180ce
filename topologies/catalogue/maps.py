"""Maps of networks: places, and ways between them with their kilometres.

They come from the package topohub (Internet Topology Zoo, SNDlib, CAIDA, …: SoftwareX 24, 101540),
or from a file: GraphML, or the JSON of the simulator SeQUeNCe.
"""

import json
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.resources import files
from math import asin, cos, radians, sin, sqrt
from pathlib import Path
from typing import Any

from topologies.system.runs.node_names import RESERVED
from wire.parameters.checks import remedy

GROUPS = ("sndlib", "topozoo", "backbone", "caida")  # in this order, for a name without its group
EARTH_KM = 6371.0088  # mean radius
NAME_LENGTH = 10  # of a host: Linux has 15 letters for NAME-eth0
OURS = re.compile(r"[cqrs]\d*|ed|src\d*|\d.*|")  # names that other nodes have, or that none can
Position = tuple[float, float]  # degrees east and north, or any others of one scale


class BadMap(ValueError):
    """A map that cannot be had; the message names it, and what there is."""


@dataclass(frozen=True)
class Place:
    """A place of a map: the name that its host has, what the map calls it, where it is."""

    name: str
    called: str
    position: Position | None = None


@dataclass(frozen=True)
class Way:
    """A way between two places, by the names of their hosts."""

    one: str
    other: str
    length_km: float
    loss_db_per_km: float | None = None  # None: the map does not say


@dataclass(frozen=True)
class Map:
    """Places, and ways between them."""

    name: str
    places: Sequence[Place]
    ways: Sequence[Way]

    def place(self, name: str) -> Place:
        """Return a place by its host's name or its own; raise BadMap if there is none."""
        for place in self.places:
            if name.lower() in (place.name, place.called.lower()):
                return place
        known = [place.name for place in self.places]
        raise BadMap(f"map {self.name} has no place {name!r}: {remedy(name, known)}")


def read_map(name: str) -> Map:
    """Return the map of a name, as abilene or sndlib/abilene, or of a file; raise BadMap."""
    path = Path(name)
    try:
        if path.suffix == ".graphml":
            return _checked(_graphml(path))
        if path.suffix == ".json":
            return _checked(_sequence(path, json.loads(path.read_text())))
    except OSError as error:
        raise BadMap(f"cannot read the map {name}: {error.strerror}") from error
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        if isinstance(error, BadMap):
            raise
        raise BadMap(f"{name} is not a map of its kind: {type(error).__name__} {error}") from error
    return _checked(_known(name))


def positions(read: Map) -> dict[str, Position]:
    """Return where each place is: as the map says, or neighbours beside each other."""
    known = {each.name: each.position for each in read.places if each.position is not None}
    if len(known) == len(read.places):
        return known
    import networkx

    graph = networkx.Graph((way.one, way.other) for way in read.ways)
    graph.add_nodes_from(each.name for each in read.places)
    laid = networkx.spring_layout(graph, seed=1)
    return {name: (float(x), float(y)) for name, (x, y) in laid.items()}


def _known(name: str) -> Map:
    """Return a map of topohub."""
    folder = files("topohub") / "data"
    if re.fullmatch(r"[a-z]+(/[\w-]+)+", name) and (folder / f"{name}.json").is_file():
        key = name
    else:
        key = _key(name, {group: _names(folder / group) for group in GROUPS})
    given = json.loads((folder / f"{key}.json").read_text())
    return _from_parts(
        key,
        [
            (node["id"], node.get("name") or str(node["id"]), node.get("pos"))
            for node in given["nodes"]
        ],
        [(edge["source"], edge["target"], edge["dist"], None) for edge in given["edges"]],
    )


WELL_KNOWN = ["abilene", "nobel-germany", "garr"]
ALIKE = 0.7  # names at least so much are a slip of the finger, by difflib's ratio


def _key(name: str, groups: Mapping[str, Iterable[str]]) -> str:
    """Return the key of a map by its name, or by what it begins with: then the newest of them."""
    wanted = name.lower()
    known = {f"{group}/{each}": each.lower() for group, names in groups.items() for each in names}
    for key, each in known.items():
        if wanted == each:
            return key
    dated = sorted(
        key for key, each in known.items() if re.fullmatch(rf"{re.escape(wanted)}\d+", each)
    )
    if dated:
        return dated[-1]
    near = get_close_matches(wanted, known.values(), 5, ALIKE) or WELL_KNOWN
    raise BadMap(
        f"there is no map {name!r}: choose one of topohub's, such as {', '.join(near)}, "
        "or a file, .graphml or SeQUeNCe's .json"
    )


def _names(folder: Any) -> list[str]:
    return sorted(each.name.removesuffix(".json") for each in folder.iterdir())


def _graphml(path: Path) -> Map:
    """Return the map of a GraphML file: names are labels, lengths `dist` (km), or great circles."""
    # Loading networkx takes a moment: other maps do not wait for it.
    import networkx

    graph = networkx.read_graphml(path)
    places = {node: _position(info) for node, info in graph.nodes(data=True)}

    def length_km(one: str, other: str, info: Mapping[str, Any]) -> float:
        if "dist" in info:
            return float(info["dist"])
        ends = places[one], places[other]
        if ends[0] is None or ends[1] is None:
            raise BadMap(
                f"{path}: {one} to {other} has no dist, in km, and not both ends have "
                "Longitude and Latitude"
            )
        return great_circle_km(ends[0], ends[1])

    return _from_parts(
        path.stem,
        [(n, str(info.get("label", n)), places[n]) for n, info in graph.nodes(data=True)],
        [(u, v, length_km(u, v, info), None) for u, v, info in graph.edges(data=True)],
    )


def _position(info: Mapping[str, Any]) -> Position | None:
    if "Longitude" in info and "Latitude" in info:
        return float(info["Longitude"]), float(info["Latitude"])
    return None


def great_circle_km(one: Position, other: Position) -> float:
    """Return the length of the great circle between two positions (haversine formula)."""
    (east1, north1), (east2, north2) = (tuple(map(radians, each)) for each in (one, other))
    half = sin((north2 - north1) / 2) ** 2
    half += cos(north1) * cos(north2) * sin((east2 - east1) / 2) ** 2
    return 2 * EARTH_KM * asin(sqrt(half))


def _sequence(path: Path, given: Mapping[str, Any]) -> Map:
    """Return the map of SeQUeNCe's JSON: `distance` is in m, `attenuation` in dB/m.

    Ways are its qconnections, or if it has none its qchannels, of which two may be one way.
    """
    ways: dict[frozenset[str], tuple[str, str, float, float]] = {}
    ends = ("node1", "node2") if "qconnections" in given else ("source", "destination")
    for each in given.get("qconnections", given.get("qchannels", ())):
        one, other = (str(each[end]) for end in ends)
        length_km, loss = float(each["distance"]) / 1e3, float(each["attenuation"]) * 1e3
        ways[frozenset((one, other))] = (one, other, length_km, loss)
    nodes = [(str(node["name"]), str(node["name"]), None) for node in given["nodes"]]
    return _from_parts(path.stem, nodes, list(ways.values()))


def _from_parts(
    name: str,
    nodes: Sequence[tuple[Any, str, Any]],
    ways: Iterable[tuple[Any, Any, float, float | None]],
) -> Map:
    """Return the map of nodes (key, name, position) and ways; none leads to where it begins."""
    hosts = dict(
        zip((key for key, _, _ in nodes), _host_names(n for _, n, _ in nodes), strict=True)
    )
    places = [
        Place(hosts[key], called, None if at is None else (float(at[0]), float(at[1])))
        for key, called, at in nodes
    ]
    for one, other, *_ in ways:
        if not {one, other} <= hosts.keys():
            raise BadMap(f"map {name}: a way from {one} to {other}, and not both are places")
    laid = [Way(hosts[a], hosts[b], float(km), loss) for a, b, km, loss in ways if a != b]
    return Map(name, places, laid)


def _host_names(called: Iterable[str]) -> Iterator[str]:
    """Yield a host name for each place, no two alike: ASCII letters and digits, at most 10."""
    taken: set[str] = set()
    for each in called:
        plain = unicodedata.normalize("NFKD", each).encode("ascii", "ignore").decode().lower()
        name = re.sub("[^a-z0-9]", "", plain)
        name = (f"h{name}" if OURS.fullmatch(name) or name in RESERVED else name)[:NAME_LENGTH]
        first, number = name, 1
        while name in taken:
            number += 1
            name = f"{first[: NAME_LENGTH - len(str(number))]}{number}"
        taken.add(name)
        yield name


def _checked(read: Map) -> Map:
    """Return the map if each place can be reached from each; raise BadMap if not."""
    if not read.places:
        raise BadMap(f"map {read.name} has no places")
    reached, found = [read.places[0].name], {read.places[0].name}
    for name in reached:  # grows
        for way in read.ways:
            if name in (way.one, way.other):
                new = {way.one, way.other} - found
                found |= new
                reached += new
    if apart := [place.name for place in read.places if place.name not in found]:
        raise BadMap(f"map {read.name}: no way from {reached[0]} to {', '.join(apart)}")
    return read
