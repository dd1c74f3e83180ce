"""How much of the time was software: moments in which the physics stood still, and waited for it.

    light under way             |=====|        |==|
    a qubit waits in a memory         |-------------------|
    software                          ^^^^^^^^^    ^^^^^^^

Light on its way, with its pulses one after the other, a switch that switches, and news of what was
done to a qubit elsewhere take the time that they take. All else is the time that programs need.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from types import MappingProxyType

from wire import dispatcher_pb2 as messages

MOST_INTERVALS = 100_000  # that are remembered; of waits that began before, less is known


class Activity:
    """When something physical went on, as intervals that do not overlap."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._begins: list[int] = []
        self._ends: list[int] = []
        self._forgotten_ns = 0
        self._first_ns: int | None = None

    def note(self, begin_ns: int, end_ns: int) -> None:
        """Note that something goes on from then to then."""
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
    def idle_share(self) -> float:
        """The share of the time from the first to the last, in which nothing went on."""
        if self._first_ns is None:
            return 0.0
        whole_ns = self._ends[-1] - self._first_ns
        went_on_ns = self._forgotten_ns + self.within(self._first_ns, self._ends[-1])
        return 1 - went_on_ns / whole_ns if whole_ns else 0.0

    def _forget(self, count: int) -> None:
        oldest = zip(self._begins[:count], self._ends[:count], strict=True)
        self._forgotten_ns += sum(end - begin for begin, end in oldest)
        del self._begins[:count], self._ends[:count]


class SoftwareTime:
    """The largest share of a wait that was software, and the share of the whole run."""

    def __init__(self, news_s: Mapping[str, Mapping[str, float]] = MappingProxyType({})) -> None:
        """Begin with no waits; news takes so long from one node to another."""
        self._activity = Activity()  # anywhere
        self._at = {node: Activity() for node in news_s}  # that a node may wait for
        self._news_ns = {
            node: {other: round(each * 1e9) for other, each in others.items() if each > 0}
            for node, others in news_s.items()
        }
        self.longest_ns = 0  # software in one wait
        self.largest_share = 0.0  # of one wait
        self.largest_decaying_share = 0.0  # of one wait that changes qubits

    def message(self) -> messages.SoftwareTime:
        """Return the figures as they go over the wire."""
        return messages.SoftwareTime(
            run_share=self._activity.idle_share,
            largest_wait_share=self.largest_share,
            largest_decaying_share=self.largest_decaying_share,
            longest_ns=self.longest_ns,
        )

    def goes_on(self, begin_ns: int, end_ns: int) -> None:
        """Note that something physical goes on from then to then, for which any node may wait."""
        for activity in (self._activity, *self._at.values()):
            activity.note(begin_ns, end_ns)

    def news(self, node: str, happened_ns: int) -> None:
        """Note that news of what happened at a node then is on its way to all others."""
        for other, delay_ns in self._news_ns.get(node, {}).items():
            self._at[other].note(happened_ns, happened_ns + delay_ns)
            self._activity.note(happened_ns, happened_ns + delay_ns)

    def waited(self, node: str, begin_ns: int, end_ns: int, decays: bool) -> None:
        """Take in that qubits waited at a node, in a memory that decays or does not."""
        if end_ns <= begin_ns:
            return
        activity = self._at.get(node, self._activity)
        software_ns = end_ns - begin_ns - activity.within(begin_ns, end_ns)
        share = software_ns / (end_ns - begin_ns)
        self.longest_ns = max(self.longest_ns, software_ns)
        self.largest_share = max(self.largest_share, share)
        if decays:
            self.largest_decaying_share = max(self.largest_decaying_share, share)
