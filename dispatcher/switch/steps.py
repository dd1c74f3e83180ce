"""A setting of a device over time: photons meet the value of the moment they pass."""

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from dispatcher.switch.timeline import REMEMBERED_NS, Times


class Steps:
    """A number that is changed from time to time."""

    def __init__(self, value: float) -> None:
        """Have had this value always."""
        self._values = [value]
        self._since_ns = [0]

    @property
    def now(self) -> float:
        return self._values[-1]

    @property
    def largest(self) -> float:
        return max(self._values)

    def set(self, value: float, now_ns: int) -> None:
        if value == self.now:
            return
        self._values.append(value)
        self._since_ns.append(now_ns)
        stale = max(bisect_right(self._since_ns, now_ns - REMEMBERED_NS) - 1, 0)
        del self._values[:stale], self._since_ns[:stale]

    def at(self, times_ns: Times) -> float | NDArray[np.float64]:
        """Return the value at each of these ascending times, or one if it was the same.

        Times must have passed by less than what is remembered.
        """
        if len(self._values) == 1:
            return self.now
        first, last = (bisect_right(self._since_ns, int(times_ns[i])) - 1 for i in (0, -1))
        if first == last:
            return self._values[first]
        steps = np.searchsorted(self._since_ns, times_ns, side="right") - 1
        return np.array(self._values)[steps]

    def highest(self, first_ns: int, last_ns: int) -> float:
        first, last = (bisect_right(self._since_ns, time_ns) - 1 for time_ns in (first_ns, last_ns))
        return max(self._values[first : last + 1])
