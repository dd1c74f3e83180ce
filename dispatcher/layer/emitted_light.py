"""The light that nodes have made, as far as they can know of it: its end when news can be there.

Under a name that a node has used it can make no more until then, and so long its light counts in
its share. Otherwise who asks again and again would hear at once what happens far away.
"""

import heapq
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

Name = tuple[int, int, int]  # session, number, half


@dataclass(slots=True)
class Made:
    """Light that a node has made under a name: its places for photons, and its parts by now."""

    places: int
    parts: int = 1
    heard_ns: int = 0  # when it can have heard of the end of those parts that have ended


class Makers:
    """The light of each node that is live, or whose end it cannot have heard of yet."""

    def __init__(self, now_ns: Callable[[], int], news_ns: Callable[[str, str], int]) -> None:
        """Begin with nothing; `news_ns` is how long news takes from a place to a node."""
        self._now_ns, self._news_ns = now_ns, news_ns
        self._made: dict[tuple[str, Name], Made] = {}
        self._ended: list[tuple[int, str, Name]] = []  # by when their makers hear of it
        self._places: Counter[str] = Counter()
        self._blocks: Counter[str] = Counter()

    def add(self, maker: str, name: Name, places: int) -> None:
        """Note a new block, or that one has come apart."""
        self._hear()
        light = self._made.get((maker, name))
        if light is not None:
            light.parts += 1
            return
        self._made[maker, name] = Made(places)
        self._places[maker] += places
        self._blocks[maker] += 1

    def grow(self, maker: str, name: Name, places: int) -> None:
        """Note that light has these further places."""
        self._made[maker, name].places += places
        self._places[maker] += places

    def end(self, maker: str, name: Name, place: str) -> None:
        """Note that a part has ended at a node, or on its way if there is none."""
        light = self._made[maker, name]
        light.parts -= 1
        if place != maker:
            light.heard_ns = max(light.heard_ns, self._now_ns() + self._news_ns(place, maker))
        if light.parts:
            return
        if light.heard_ns:
            heapq.heappush(self._ended, (light.heard_ns, maker, name))
        else:
            self._forget(maker, name)

    def parts(self, maker: str, name: Name) -> int:
        """Return of how many parts under a name its maker cannot have heard that they ended."""
        self._hear()
        light = self._made.get((maker, name))
        if light is None:
            return 0
        return light.parts + (light.heard_ns > self._now_ns())

    def places_of(self, maker: str) -> int:
        self._hear()
        return self._places[maker]

    def blocks_of(self, maker: str) -> int:
        """Return how many blocks a node has made, as far as it knows."""
        self._hear()
        return self._blocks[maker]

    def _hear(self) -> None:
        if not self._ended:
            return
        now_ns = self._now_ns()
        while self._ended and self._ended[0][0] <= now_ns:
            heard_ns, maker, name = heapq.heappop(self._ended)
            light = self._made.get((maker, name))
            if light is not None and not light.parts and light.heard_ns == heard_ns:
                self._forget(maker, name)

    def _forget(self, maker: str, name: Name) -> None:
        light = self._made.pop((maker, name))
        for counted, less in ((self._places, light.places), (self._blocks, 1)):
            counted[maker] -= less
            if not counted[maker]:
                del counted[maker]
