"""How much of the time was software: what is left of a wait without all that physics took.

    charlie  sends light
                \\ arrives, which takes                     arrives at bob, too, and waits there
    alice         *--- software ---measures                  |
                                      \\ news, which takes    |
    bob                                  *--- software ---used: the wait is over

The way back from the end of a wait goes from each deed to what its host heard of last: light that
arrived there, or what was done elsewhere and could be known there by then. Between the two were
programs. Messages along the copper without a measurement before them count as theirs, too.
"""

from bisect import bisect_left, bisect_right, insort
from collections import defaultdict
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeVar

from programs.shortest_paths import shortest
from wire import dispatcher_pb2 as messages

MOST_INTERVALS = 100_000  # that are remembered; of waits that began before, less is known
MOST_DEEDS = 100_000  # of a node, likewise
MOST_STEPS = 1_000  # back from the end of a wait; what is before them counts as software


T = TypeVar("T")


class Cause(NamedTuple):
    """An arrival at a node: from another node, where it had begun before."""

    came_ns: int
    origin: str
    began_ns: int


class Activity:
    """When something physical went on, as intervals that do not overlap."""

    def __init__(self) -> None:
        self._begins: list[int] = []
        self._ends: list[int] = []
        self._forgotten_ns = 0
        self._first_ns: int | None = None

    def note(self, begin_ns: int, end_ns: int) -> None:
        if self._first_ns is None or begin_ns < self._first_ns:
            self._first_ns = begin_ns
        # Those that it touches become one with it.
        first, last = bisect_left(self._ends, begin_ns), bisect_right(self._begins, end_ns)
        if first < last:
            begin_ns = min(begin_ns, self._begins[first])
            end_ns = max(end_ns, self._ends[last - 1])
        self._begins[first:last], self._ends[first:last] = [begin_ns], [end_ns]
        if len(self._ends) > MOST_INTERVALS:
            self._forget(MOST_INTERVALS // 2)

    def within(self, begin_ns: int, end_ns: int) -> int:
        """Return for how long (ns) something went on in an interval."""
        first, last = bisect_right(self._ends, begin_ns), bisect_left(self._begins, end_ns)
        parts = zip(self._begins[first:last], self._ends[first:last], strict=True)
        return sum(min(end, end_ns) - max(begin, begin_ns) for begin, end in parts)

    @property
    def has_begun(self) -> bool:
        return self._first_ns is not None

    def idle_share(self, last_ns: int) -> float:
        """Return the share of the time until then in which nothing went on."""
        if self._first_ns is None:
            return 0.0
        whole_ns = last_ns - self._first_ns
        went_on_ns = self._forgotten_ns + self.within(self._first_ns, last_ns)
        return 1 - went_on_ns / whole_ns if whole_ns else 0.0

    def _forget(self, count: int) -> None:
        oldest = zip(self._begins[:count], self._ends[:count], strict=True)
        self._forgotten_ns += sum(end - begin for begin, end in oldest)
        del self._begins[:count], self._ends[:count]


class SoftwareTime:
    """The largest share of a wait that was software, and the share of the whole run."""

    def __init__(self, news_s: Mapping[str, Mapping[str, float]] = MappingProxyType({})) -> None:
        """Begin with no waits; news takes so long from each node to its neighbours."""
        self._activity = Activity()
        self._last_light_ns = 0
        self._news_s = news_s
        self._news_ns: dict[str, dict[str, int]] = {}  # from all others, of nodes where it counted
        self._deeds_ns: defaultdict[str, list[int]] = defaultdict(list)  # that others hear of
        self._light: defaultdict[str, list[Cause]] = defaultdict(list)  # by where it came to
        self.longest_ns = 0  # software in one wait
        self.largest_share = 0.0  # of one wait
        self.largest_decaying_share = 0.0  # of one wait that changes qubits

    def message(self) -> messages.SoftwareTime:
        return messages.SoftwareTime(
            run_share=self._activity.idle_share(self._last_light_ns),
            largest_wait_share=self.largest_share,
            largest_decaying_share=self.largest_decaying_share,
            longest_ns=self.longest_ns,
        )

    def goes_on(self, begin_ns: int, end_ns: int) -> None:
        self._activity.note(begin_ns, end_ns)
        self._last_light_ns = max(self._last_light_ns, end_ns)

    def switches(self, begin_ns: int, end_ns: int) -> None:
        """Note that paths are set; before the first light and behind the last it does not count."""
        if self._activity.has_begun:
            self._activity.note(begin_ns, end_ns)

    def news(self, node: str, happened_ns: int) -> None:
        insort(_forgetting(self._deeds_ns[node]), happened_ns)

    def light(self, sender: str, sent_ns: int, receiver: str, came_ns: int) -> None:
        insort(_forgetting(self._light[receiver]), Cause(came_ns, sender, sent_ns))
        self.news(receiver, came_ns)

    def news_from_ns(self, origin: str, node: str) -> int | None:
        """Return how long news takes from one node to another, None if by nothing but light."""
        return self._delays_ns(node).get(origin)

    def farthest_news_ns(self, node: str) -> int:
        return max(self._delays_ns(node).values())

    def longest_news_ns(self, place: str, node: str) -> int:
        """Return the same from a place; from where light or nobody tells, as from the farthest."""
        from_there = self.news_from_ns(place, node)
        return self.farthest_news_ns(node) if from_there is None else from_there

    def waited(self, node: str, begin_ns: int, end_ns: int, decays: bool) -> None:
        if end_ns <= begin_ns:
            return
        software_ns = self._software(node, begin_ns, end_ns)
        share = software_ns / (end_ns - begin_ns)
        self.longest_ns = max(self.longest_ns, software_ns)
        self.largest_share = max(self.largest_share, share)
        if decays:
            self.largest_decaying_share = max(self.largest_decaying_share, share)

    def _software(self, node: str, begin_ns: int, end_ns: int) -> int:
        """Go back from the end of a wait to its begin, and add up what was between deeds."""
        software_ns, at_ns = 0, end_ns
        for _ in range(MOST_STEPS):
            # Of what came at one moment, that which took longest: light, and not word of it.
            causes = self._causes(node, at_ns)
            cause = max(causes, key=lambda each: (each.came_ns, -each.began_ns), default=None)
            if cause is None or cause.came_ns <= begin_ns:
                break
            software_ns += at_ns - cause.came_ns
            node, at_ns = cause.origin, cause.began_ns
            if at_ns <= begin_ns:
                return software_ns
        return software_ns + at_ns - begin_ns

    def _causes(self, node: str, before_ns: int) -> Iterator[Cause]:
        """Yield the last that came to a node by then: light, and news from each other node."""
        light = self._light[node]
        place = bisect_right(light, before_ns, key=lambda each: each.came_ns)
        if place and light[place - 1].began_ns < before_ns:
            yield light[place - 1]
        delays_ns = self._delays_ns(node)
        for other, deeds_ns in self._deeds_ns.items():
            delay_ns = delays_ns.get(other, 0)
            if other != node and (place := bisect_left(deeds_ns, before_ns - delay_ns)):
                yield Cause(deeds_ns[place - 1] + delay_ns, other, deeds_ns[place - 1])

    def _delays_ns(self, node: str) -> dict[str, int]:
        if node not in self._news_ns:
            reached = shortest(self._news_s, node)
            self._news_ns[node] = {other: round(each * 1e9) for other, each in reached.items()}
        return self._news_ns[node]


def _forgetting(remembered: list[T]) -> list[T]:
    """Return the list, without its older half if it has become too long."""
    if len(remembered) >= MOST_DEEDS:
        del remembered[: MOST_DEEDS // 2]
    return remembered
