"""The cross-connects of one quantum switch over time.

in_port 1   ====2====|  dark  |=====3=====...
                     closes   opens
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

REMEMBERED_NS = 60_000_000_000
DARK = 0  # OpenFlow has no port 0
NEVER_NS = 1 << 62


@dataclass
class Interval:
    """Light passes to out_port from opens_ns on, until just before closes_ns."""

    opens_ns: int
    out_port: int
    closes_ns: int = NEVER_NS


class Timeline:
    """Which output each input of a switch was connected to, and when."""

    def __init__(self, switching_time_ns: int) -> None:
        """Begin with no connection; a new one takes the switching time to open."""
        self._switching_time_ns = switching_time_ns
        self._intervals: dict[int, list[Interval]] = {}

    def connect(
        self, connections: dict[int, int], now_ns: int
    ) -> tuple[int, dict[int, int], dict[int, int]]:
        """Replace the set of connections (in_port to out_port) from now on.

        Those that stay are not interrupted. Return when all are open, those that are new and
        those that are closed.
        """
        before = {
            in_port: intervals[-1].out_port
            for in_port, intervals in self._intervals.items()
            if intervals[-1].closes_ns == NEVER_NS
        }
        closed = {i: o for i, o in before.items() if connections.get(i) != o}
        opened = {i: o for i, o in connections.items() if before.get(i) != o}
        for in_port in closed:
            self._close(in_port, now_ns)
        opens_ns = now_ns + self._switching_time_ns
        for in_port, out_port in opened.items():
            self._intervals.setdefault(in_port, []).append(Interval(opens_ns, out_port))
        self._forget(now_ns - REMEMBERED_NS)
        newest = max((self._intervals[i][-1].opens_ns for i in connections), default=now_ns)
        return max(newest, now_ns), opened, closed

    def path(self, in_port: int, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the output that light took at each of these ascending times, DARK for none.

        Times must have passed, and by less than what is remembered.
        """
        out_ports = np.full(len(times_ns), DARK, dtype=np.int64)
        if not len(times_ns):
            return out_ports
        intervals = self._intervals.get(in_port, [])
        first = bisect_right(intervals, int(times_ns[0]), key=lambda i: i.opens_ns) - 1
        for interval in intervals[max(first, 0) :]:
            if interval.opens_ns > times_ns[-1]:
                break
            begin, end = np.searchsorted(times_ns, (interval.opens_ns, interval.closes_ns))
            out_ports[begin:end] = interval.out_port
        return out_ports

    def _close(self, in_port: int, now_ns: int) -> None:
        intervals = self._intervals[in_port]
        if intervals[-1].opens_ns >= now_ns:
            intervals.pop()  # it never came to open
        else:
            intervals[-1].closes_ns = now_ns
        if not intervals:
            del self._intervals[in_port]

    def _forget(self, before_ns: int) -> None:
        for in_port, intervals in list(self._intervals.items()):
            stale = 0
            while stale < len(intervals) and intervals[stale].closes_ns < before_ns:
                stale += 1
            del intervals[:stale]
            if not intervals:
                del self._intervals[in_port]
