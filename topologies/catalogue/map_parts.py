"""The parts of a map: places, the names of their hosts, and ways between them."""

import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import asin, cos, isfinite, radians, sin, sqrt
from typing import Any

from topologies.system.runs.node_names import RESERVED
from wire.parameters.checks import remedy

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
class MapLink:
    """A way between two places, by the names of their hosts."""

    one: str
    other: str
    length_km: float
    loss_db_per_km: float | None = None  # None: the map does not say


@dataclass(frozen=True)
class Map:
    name: str
    places: Sequence[Place]
    links: Sequence[MapLink]
    unused: Sequence[str] = ()  # fields of its file that say nothing here

    def place(self, name: str) -> Place:
        """Return a place by its host's name or its own; raise BadMap if there is none."""
        for place in self.places:
            if spelling(name) in (place.name, spelling(place.called)):
                return place
        names = [place.name for place in self.places]
        raise BadMap(f"map {self.name} has no place {name!r}: {remedy(name, names)}")


def spelling(name: str) -> str:
    """Return a name so that other ways to write it in Unicode are the same."""
    return unicodedata.normalize("NFKC", name).casefold().strip()


def great_circle_km(one: Position, other: Position) -> float:
    """Return the length of the great circle between two positions (haversine formula)."""
    (east1, north1), (east2, north2) = (tuple(map(radians, each)) for each in (one, other))
    half = sin((north2 - north1) / 2) ** 2
    half += cos(north1) * cos(north2) * sin((east2 - east1) / 2) ** 2
    return 2 * EARTH_KM * asin(sqrt(half))


def from_parts(
    name: str,
    nodes: Sequence[tuple[Any, str, Any]],
    links: Sequence[tuple[Any, Any, float, float | None]],
    unused: Sequence[str] = (),
) -> Map:
    """Return the map of nodes (key, name, position) and ways; none leads to where it begins."""
    hosts = dict(
        zip((key for key, _, _ in nodes), _host_names(n for _, n, _ in nodes), strict=True)
    )
    places = [
        Place(hosts[key], called, None if at is None else (float(at[0]), float(at[1])))
        for key, called, at in nodes
    ]
    for one, other, length_km, _loss in links:
        if not {one, other} <= hosts.keys():
            raise BadMap(f"map {name}: a way from {one} to {other}, and not both are places")
        if not isfinite(length_km):
            raise BadMap(
                f"map {name}: a way from {one} to {other} of {length_km} km: give a number"
            )
    laid = [MapLink(hosts[a], hosts[b], float(km), loss) for a, b, km, loss in links if a != b]
    return Map(name, places, laid, unused)


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
