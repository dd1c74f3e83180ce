"""The memory of a channel: values that a noise model has found in one fibre and direction.

A value holds from its time on, until the next one. The dispatcher's history keeps the last of
them, as many as it is deep.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]
Values = NDArray[np.float64]


class NoiseHistory:
    """Values over time: the latest `depth` of them at least, none if that is 0."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._chunks: deque[tuple[Times, Values]] = deque()
        self._count = 0

    @property
    def latest(self) -> tuple[int, float] | None:
        """The last value and the time it holds from, None if nothing is remembered."""
        if not self._chunks:
            return None
        times_ns, values = self._chunks[-1]
        return int(times_ns[-1]), float(values[-1])

    @property
    def latest_ns(self) -> int | None:
        """The time from which the last value holds, None if nothing is remembered."""
        return int(self._chunks[-1][0][-1]) if self._chunks else None

    @property
    def latest_values(self) -> tuple[int, Values] | None:
        """The same as `latest` where a value is an array, shape (c,)."""
        return (int(self._chunks[-1][0][-1]), self._chunks[-1][1][-1]) if self._chunks else None

    def remember(self, times_ns: Times, values: Values) -> None:
        """Add values at ascending times, shape (k,) or (k, c); early ones hold from the latest on.

        Blocks that pass at the same time may be resolved in any order.
        """
        if self._chunks:
            times_ns = np.maximum(times_ns, self._chunks[-1][0][-1])
        kept = slice(max(len(times_ns) - self._depth, 0), None)
        if not len(times_ns[kept]):
            return
        self._chunks.append((times_ns[kept], values[kept]))
        self._count += len(times_ns[kept])
        while self._count - len(self._chunks[0][0]) >= self._depth:
            self._count -= len(self._chunks.popleft()[0])

    def at(self, times_ns: Times) -> Values:
        """Return what held at these ascending times, shape (k,); the first value before it."""
        since_ns = np.concatenate([times for times, _values in self._chunks])
        values = np.concatenate([values for _times, values in self._chunks])
        first, last = since_ns.searchsorted(times_ns[[0, -1]], side="right")
        met = slice(max(first - 1, 0), max(last, 1))
        begins = times_ns.searchsorted(since_ns[met])
        begins[0] = 0
        return np.repeat(values[met], np.diff(begins, append=len(times_ns)), axis=0)
