"""How long news takes along the copper: what a node cannot know earlier of another."""

from collections.abc import Mapping
from types import MappingProxyType

from programs.shortest_paths import shortest


class NewsDelays:
    """Delays (ns) from all other nodes to one; found once, for nodes that are asked for."""

    def __init__(self, news_s: Mapping[str, Mapping[str, float]] = MappingProxyType({})) -> None:
        """News takes so long from each node to its neighbours."""
        self._news_s = news_s
        self._news_ns: dict[str, dict[str, int]] = {}

    def from_ns(self, origin: str, node: str) -> int | None:
        """Return how long news takes from one node to another, None if by nothing but light."""
        return self._delays_ns(node).get(origin)

    def farthest_ns(self, node: str) -> int:
        return max(self._delays_ns(node).values())

    def longest_ns(self, place: str, node: str) -> int:
        """Return the delay from a place; from where light or nobody tells, as from the farthest."""
        from_there = self.from_ns(place, node)
        return self.farthest_ns(node) if from_there is None else from_there

    def _delays_ns(self, node: str) -> dict[str, int]:
        if node not in self._news_ns:
            reached = shortest(self._news_s, node)
            self._news_ns[node] = {other: round(each * 1e9) for other, each in reached.items()}
        return self._news_ns[node]
