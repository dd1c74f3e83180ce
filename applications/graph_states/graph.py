"""Graphs of hosts in a line, and how pairs between neighbours of the line make their edges.

An edge between hosts that are not neighbours is made of a pair on each link between them, swapped
at the hosts on its way. Edges whose ways have no link in common are made in one layer of pairs
along the line: a ring of A, B, C and D takes two layers,

    A ===== B ===== C ===== D      edges A-B, B-C and C-D
    A ===== x ===== x ===== D      edge A-D, swapped at B and C

A hub takes no part in the state: its qubit is measured in Y, which joins each two of its neighbours
that were apart, and parts those that were joined (local complementation: Hein, Eisert and Briegel,
Phys. Rev. A 69, 062311, 2004). Of a star the others are left in a GHZ state, but for local gates.
"""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from applications.ghz.options import LEAST_HOSTS, MOST_HOSTS
from wire.parameters.checks import remedy

Edge = tuple[int, int]  # places in the line, the lower first


class Half(NamedTuple):
    layer: int
    came: bool  # from the left; if not, it was made here
    far: int  # the host with the other end of its edge


class Swap(NamedTuple):
    """Two pairs that a host joins, on the way of an edge."""

    layer: int
    edge: Edge


@dataclass(frozen=True)
class Graph:
    """Which hosts of a line are joined; ValueError for what is not a connected graph of all."""

    hosts: int
    edges: tuple[Edge, ...]
    hub: int = 0  # 0: none; the first host has a part in the state

    def __post_init__(self) -> None:
        if not LEAST_HOSTS <= self.hosts <= MOST_HOSTS:
            raise ValueError(f"{self.hosts} hosts, of {LEAST_HOSTS} to {MOST_HOSTS}")
        if any(not 0 <= a < b < self.hosts for a, b in self.edges):
            raise ValueError(f"an edge joins two different ones of {self.hosts} hosts")
        if len(set(self.edges)) != len(self.edges):
            raise ValueError("an edge occurs twice: name each edge once")
        if apart := set(range(self.hosts)) - self._joined():
            raise ValueError(f"no edges lead from the first host to number {min(apart) + 1}")
        if not 0 <= self.hub < self.hosts:
            raise ValueError(f"no host of {self.hosts} is hub {self.hub}")

    def _joined(self) -> set[int]:
        reached, left = {0}, {0}
        while left:
            left = {there for here in left for there in self.neighbours(here)} - reached
            reached |= left
        return reached

    def neighbours(self, place: int) -> set[int]:
        return {b if a == place else a for a, b in self.edges if place in (a, b)}

    @property
    def members(self) -> list[int]:
        return [place for place in range(self.hosts) if place != self.hub or not self.hub]

    def left(self) -> "Graph":
        """Return the graph of the members when the hub is measured, by their order."""
        if not self.hub:
            return self
        edges = set(self.edges) ^ set(combinations(sorted(self.neighbours(self.hub)), 2))
        order = {place: each for each, place in enumerate(self.members)}
        remaining = sorted(edge for edge in edges if self.hub not in edge)
        return Graph(len(order), tuple((order[a], order[b]) for a, b in remaining))

    def due(self, place: int) -> list[int]:
        """Return at which hosts Z is due where it is at one: for a hub, at its neighbours."""
        return sorted(self.neighbours(place)) if self.hub and place == self.hub else [place]

    @cached_property
    def adjacency(self) -> NDArray[np.uint8]:
        """Return 1 for hosts that are joined; shape (hosts, hosts)."""
        joined = np.zeros((self.hosts, self.hosts), dtype=np.uint8)
        for a, b in self.edges:
            joined[a, b] = joined[b, a] = 1
        return joined

    @cached_property
    def layers(self) -> tuple[tuple[Edge, ...], ...]:
        """Return the edges of each layer of pairs: as few layers as the busiest link has edges."""
        layers: list[list[Edge]] = []
        for edge in sorted(self.edges):
            free = next((layer for layer in layers if layer[-1][1] <= edge[0]), None)
            if free is None:
                layers.append([edge])
            else:
                free.append(edge)
        return tuple(map(tuple, layers))

    @property
    def pairs(self) -> int:
        return sum(b - a for a, b in self.edges)

    def kept(self, place: int) -> int:
        """Return how many halves of pairs of one state a host keeps at most."""
        return len(self.halves(place)) + 2 * len(self.swaps(place))

    def lit(self, layer: int, place: int) -> bool:
        return any(a <= place < b for a, b in self.layers[layer])

    def halves(self, place: int) -> list[Half]:
        return [
            Half(layer, came=place == b, far=a if place == b else b)
            for layer, edges in enumerate(self.layers)
            for a, b in edges
            if place in (a, b)
        ]

    def swaps(self, place: int) -> list[Swap]:
        return [
            Swap(layer, (a, b))
            for layer, edges in enumerate(self.layers)
            for a, b in edges
            if a < place < b
        ]

    @cached_property
    def colours(self) -> tuple[int, ...]:
        """Return a colour for each host, other than those of its neighbours; two if that can be."""
        by_place = self._two_colours()
        if any(by_place[a] == by_place[b] for a, b in self.edges):
            by_place = {}
            for place in range(self.hosts):
                taken = {by_place.get(there) for there in self.neighbours(place)}
                by_place[place] = next(each for each in range(self.hosts) if each not in taken)
        return tuple(by_place[place] for place in range(self.hosts))

    def _two_colours(self) -> dict[int, int]:
        by_place, left, colour = {0: 0}, {0}, 0
        while left:
            colour ^= 1
            left = {there for here in left for there in self.neighbours(here)} - by_place.keys()
            by_place |= dict.fromkeys(left, colour)
        return by_place


def _ring(hosts: int) -> list[Edge]:
    return sorted({*pairwise(range(hosts)), (0, hosts - 1)})


NAMED: dict[str, Callable[[int], Iterable[Edge]]] = {
    "line": lambda hosts: pairwise(range(hosts)),
    "ring": _ring,
    "star": lambda hosts: [(0, place) for place in range(1, hosts)],
    "complete": lambda hosts: combinations(range(hosts), 2),
}


def read_graph(text: str, names: list[str], hub: str = "") -> Graph:
    """Return the graph of words such as `ring` or `alice-bob,bob-charlie`; ValueError else."""
    if hub and hub not in names[1:]:
        raise ValueError(f"hub {hub}: {remedy(hub, names[1:])}")
    place = names.index(hub) if hub else 0
    if text in NAMED:
        return Graph(len(names), tuple(NAMED[text](len(names))), place)
    return Graph(len(names), tuple(_edge(word, names) for word in text.split(",")), place)


def _edge(word: str, names: Collection[str]) -> Edge:
    """Return the edge that a word says; names of hosts may have hyphens, too."""
    for (a, first), (b, second) in combinations(enumerate(names), 2):
        if word in (f"{first}-{second}", f"{second}-{first}"):
            return a, b
    text = f"{word!r} is not an edge between two of {', '.join(names)}"
    raise ValueError(f"{text}: write {', '.join(NAMED)}, or edges as A-B,B-C")


def numbers_of_graph(graph: Graph) -> list[int]:
    return [graph.hosts, graph.hub, *(place for edge in graph.edges for place in edge)]


def graph_of_numbers(numbers: Iterable[int]) -> Graph:
    """Return the graph that hosts tell; ValueError for anything else."""
    hosts, hub, *places = numbers
    if len(places) % 2:
        raise ValueError("an edge has two ends")
    return Graph(hosts, tuple(zip(places[::2], places[1::2], strict=True)), hub)
