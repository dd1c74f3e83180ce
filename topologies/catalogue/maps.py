"""Maps of networks: places, and ways between them with their kilometres.

They come from the package topohub (Internet Topology Zoo, SNDlib, CAIDA, …: SoftwareX 24, 101540),
or from a file: GraphML, or the JSON of the simulator SeQUeNCe.
"""

import json
import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

from topologies.catalogue.map_files import read_file
from topologies.catalogue.map_parts import BadMap as BadMap
from topologies.catalogue.map_parts import Map as Map
from topologies.catalogue.map_parts import Place as Place
from topologies.catalogue.map_parts import Position as Position
from topologies.catalogue.map_parts import from_parts
from wire.registered import Registry

PACKAGES = Registry[Path]("qmn.maps", lambda each: isinstance(each, Path), {})
GROUPS = ("sndlib", "topozoo", "backbone", "caida")  # in this order, for a name without its group


def read_map(name: str) -> Map:
    """Return the map of a name, as abilene or sndlib/abilene, or of a file; raise BadMap."""
    path = PACKAGES.get(name, Path(name))
    if path.suffix in (".graphml", ".json"):
        return _checked(read_file(path))
    return _checked(_known(name))


def positions(read: Map) -> dict[str, Position]:
    """Return where each place is: as the map says, or neighbours beside each other."""
    located = {place.name: place.position for place in read.places if place.position is not None}
    if len(located) == len(read.places):
        return located
    import networkx

    graph = networkx.Graph((link.one, link.other) for link in read.links)
    graph.add_nodes_from(place.name for place in read.places)
    laid = networkx.spring_layout(graph, seed=1)
    return {name: (float(x), float(y)) for name, (x, y) in laid.items()}


def _known(name: str) -> Map:
    folder = files("topohub") / "data"
    if re.fullmatch(r"[a-z]+(/[\w-]+)+", name) and (folder / f"{name}.json").is_file():
        key = name
    else:
        key = _key(name, {group: _names(folder / group) for group in GROUPS})
    content = json.loads((folder / f"{key}.json").read_text())
    return from_parts(
        key,
        [
            (node["id"], node.get("name") or str(node["id"]), node.get("pos"))
            for node in content["nodes"]
        ],
        [(edge["source"], edge["target"], edge["dist"], None) for edge in content["edges"]],
    )


WELL_KNOWN = ["abilene", "nobel-germany", "garr"]
ALIKE = 0.7  # names at least so much are a slip of the finger, by difflib's ratio


def _key(name: str, groups: Mapping[str, Iterable[str]]) -> str:
    """Return the key of a map by its name, or by what it begins with: then the newest of them."""
    lower = name.lower()
    names_of_maps = {
        f"{group}/{each}": each.lower() for group, names in groups.items() for each in names
    }
    for key, each in names_of_maps.items():
        if lower == each:
            return key
    dated = sorted(
        key for key, each in names_of_maps.items() if re.fullmatch(rf"{re.escape(lower)}\d+", each)
    )
    if dated:
        return dated[-1]
    near = get_close_matches(lower, names_of_maps.values(), 5, ALIKE) or WELL_KNOWN
    raise BadMap(
        f"there is no map {name!r}: choose one of topohub's, such as {', '.join(near)}, "
        "or a file, .graphml or SeQUeNCe's .json"
    )


def _names(folder: Any) -> list[str]:
    return sorted(path.name.removesuffix(".json") for path in folder.iterdir())


def _checked(read: Map) -> Map:
    """Return the map if each place can be reached from each; raise BadMap if not."""
    if not read.places:
        raise BadMap(f"map {read.name} has no places")
    reached, joined = [read.places[0].name], {read.places[0].name}
    for name in reached:  # grows
        for link in read.links:
            if name in (link.one, link.other):
                new = {link.one, link.other} - joined
                joined |= new
                reached += new
    if apart := [place.name for place in read.places if place.name not in joined]:
        raise BadMap(f"map {read.name}: no way from {reached[0]} to {', '.join(apart)}")
    return read
