"""Distances between the nodes of a network, and the shortest paths."""

import heapq
from collections.abc import Mapping

Distances = dict[str, dict[str, float]]  # from each node to its neighbours: lengths, or times


def shortest(distances: Mapping[str, Mapping[str, float]], start: str) -> dict[str, float]:
    """Return the distances from a node to itself and all nodes that it reaches (Dijkstra)."""
    reached: dict[str, float] = {}
    queue = [(0.0, start)]
    while queue:
        distance, node = heapq.heappop(queue)
        if node not in reached:
            reached[node] = distance
            for neighbor, length in distances.get(node, {}).items():
                heapq.heappush(queue, (distance + length, neighbor))
    return reached
