"""Ways between the nodes of a network, and the shortest of them."""

import heapq
from collections.abc import Mapping

Ways = dict[str, dict[str, float]]  # from each node to its neighbours: lengths, or times


def shortest(ways: Mapping[str, Mapping[str, float]], start: str) -> dict[str, float]:
    """Return how far it is from a node to itself and all that it reaches (Dijkstra)."""
    reached: dict[str, float] = {}
    queue = [(0.0, start)]
    while queue:
        so_far, node = heapq.heappop(queue)
        if node not in reached:
            reached[node] = so_far
            for far, more in ways.get(node, {}).items():
                heapq.heappush(queue, (so_far + more, far))
    return reached
