"""The cross-connects of one quantum switch over time.

in_port 1   ====2====|  dark  |=====3=====...
                     closes   opens
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

REMEMBERED_NS = 60_000_000_000
DARK = 0  # OpenFlow has no port 0
NEVER_NS = 1 << 62


class Times(Protocol):
    """Ascending times of k photons, as in an array; mostly the first and the last are wanted."""

    def __len__(self) -> int: ...

    def __getitem__(self, photon: int, /) -> Any: ...

    def __array__(self) -> NDArray[np.int64]: ...


@dataclass(eq=False)
class Circuit:
    """A caller's name for a cross-connect, and how much light has passed under it."""

    number: int
    since_ns: int  # when light could first pass
    last_ns: int  # when the last photon passed, or since_ns
    photons: int = 0
    closed_ns: int = NEVER_NS

    def count_light(self, photons: int, last_ns: int) -> None:
        """Count photons of light whose last pulse passed then."""
        self.photons += photons
        self.last_ns = max(self.last_ns, last_ns)

    def count(self, passed: NDArray[np.bool_], times_ns: Times, first: int = 0) -> None:
        photons = int(np.count_nonzero(passed))
        if photons:
            last = first + passed.tobytes().rfind(1)
            self.count_light(photons, int(times_ns[last]))


@dataclass
class Interval:
    """Light passes to out_port from opens_ns on, until just before closes_ns."""

    opens_ns: int
    out_port: int
    circuit: Circuit
    closes_ns: int = NEVER_NS

    def part(self, times_ns: Times) -> slice:
        if self.opens_ns <= times_ns[0] and times_ns[-1] < self.closes_ns:
            return slice(0, len(times_ns))
        begin, end = np.searchsorted(times_ns, (self.opens_ns, self.closes_ns))
        return slice(int(begin), int(end))


class Timeline:
    """Which output each input of a switch was connected to, and when."""

    def __init__(self, switching_time_ns: int) -> None:
        """Begin with no connection; a new one takes the switching time to open."""
        self._switching_time_ns = switching_time_ns
        self._intervals: dict[int, list[Interval]] = {}
        self._circuits: dict[int, Circuit] = {}
        self._lit: dict[int, Circuit] = {}  # of those, the ones that are not closed
        self._dark: deque[tuple[int, Circuit]] = deque()  # when each closed; may be lit again

    def connect(
        self, connections: dict[int, int], now_ns: int, circuits: Mapping[int, int] | None = None
    ) -> tuple[int, dict[int, int], dict[int, int]]:
        """Replace the set of connections (in_port to out_port) from now on.

        Those that stay are not interrupted, also if their circuit (by in_port; 0 if it is
        not given) is another one from now on. Return when all are open, those that are new
        and those that are closed.
        """
        self._forget(now_ns - REMEMBERED_NS)
        numbers = circuits or {}
        before = self.connections
        closed = {i: o for i, o in before.items() if connections.get(i) != o}
        opened = {i: o for i, o in connections.items() if before.get(i) != o}
        for in_port in closed:
            self._close(in_port, now_ns)
        opens_ns = now_ns + self._switching_time_ns
        for in_port, out_port in connections.items():
            number = numbers.get(in_port, 0)
            if in_port in opened:
                interval = Interval(opens_ns, out_port, self._circuit(number, opens_ns))
                self._intervals.setdefault(in_port, []).append(interval)
            else:
                self._rename(in_port, number, now_ns)
        self._close_circuits(now_ns)
        newest = max((self._intervals[i][-1].opens_ns for i in connections), default=now_ns)
        return max(newest, now_ns), opened, closed

    @property
    def connections(self) -> dict[int, int]:
        return {in_port: interval.out_port for in_port, interval in self._open()}

    def open_outputs(self, now_ns: int) -> dict[int, int]:
        """Return the outputs to which light passes at this time, by input."""
        return {i: interval.out_port for i, interval in self._open() if interval.opens_ns <= now_ns}

    @property
    def open_circuits(self) -> dict[int, int]:
        return {in_port: interval.circuit.number for in_port, interval in self._open()}

    def circuit_of(self, in_port: int) -> Circuit | None:
        return next((interval.circuit for port, interval in self._open() if port == in_port), None)

    def circuits(self, now_ns: int) -> list[Circuit]:
        recent = [c for c in self._circuits.values() if c.closed_ns >= now_ns - REMEMBERED_NS]
        return sorted(recent, key=lambda circuit: circuit.number)

    def passages(self, in_port: int, times_ns: Times) -> Iterator[tuple[slice, Interval]]:
        """Return the intervals that light met at these ascending times, each with its part.

        Times must have passed, and by less than what is remembered.
        """
        if not len(times_ns):
            return
        intervals = self._intervals.get(in_port, [])
        first = bisect_right(intervals, int(times_ns[0]), key=lambda i: i.opens_ns) - 1
        for interval in intervals[max(first, 0) :]:
            if interval.opens_ns > times_ns[-1]:
                break
            part = interval.part(times_ns)
            if part.start < part.stop:
                yield part, interval

    def path(self, in_port: int, times_ns: Times) -> NDArray[np.int64]:
        """Return the output that light took at each of these times, DARK for none."""
        out_ports = np.full(len(times_ns), DARK, dtype=np.int64)
        for part, interval in self.passages(in_port, times_ns):
            out_ports[part] = interval.out_port
        return out_ports

    def outputs_in_use(self, times_ns: Times) -> dict[int, NDArray[np.bool_]]:
        """Return for each output when a path to it was open, shape (k,)."""
        in_use: dict[int, NDArray[np.bool_]] = {}
        for in_port in self._intervals:
            for part, interval in self.passages(in_port, times_ns):
                mask = in_use.setdefault(interval.out_port, np.zeros(len(times_ns), dtype=bool))
                mask[part] = True
        return in_use

    def _open(self) -> Iterator[tuple[int, Interval]]:
        for in_port, intervals in self._intervals.items():
            if intervals[-1].closes_ns == NEVER_NS:
                yield in_port, intervals[-1]

    def _circuit(self, number: int, since_ns: int) -> Circuit:
        circuit = self._circuits.setdefault(number, Circuit(number, since_ns, since_ns))
        circuit.closed_ns = NEVER_NS
        self._lit[number] = circuit
        return circuit

    def _rename(self, in_port: int, number: int, now_ns: int) -> None:
        interval = self._intervals[in_port][-1]
        if interval.circuit.number == number:
            return
        since_ns = max(interval.opens_ns, now_ns)
        circuit = self._circuit(number, since_ns)
        if interval.opens_ns >= now_ns:
            interval.circuit = circuit
        else:
            interval.closes_ns = now_ns
            self._intervals[in_port].append(Interval(now_ns, interval.out_port, circuit))

    def _close(self, in_port: int, now_ns: int) -> None:
        intervals = self._intervals[in_port]
        if intervals[-1].opens_ns >= now_ns:
            intervals.pop()  # it never came to open
        else:
            intervals[-1].closes_ns = now_ns
        if not intervals:
            del self._intervals[in_port]

    def _close_circuits(self, now_ns: int) -> None:
        open_numbers = set(self.open_circuits.values())
        for number in self._lit.keys() - open_numbers:
            circuit = self._lit.pop(number)
            circuit.closed_ns = now_ns
            self._dark.append((now_ns, circuit))

    def _forget(self, before_ns: int) -> None:
        for in_port, intervals in list(self._intervals.items()):
            stale = 0
            while stale < len(intervals) and intervals[stale].closes_ns < before_ns:
                stale += 1
            del intervals[:stale]
            if not intervals:
                del self._intervals[in_port]
        while self._dark and self._dark[0][0] < before_ns:
            closed_ns, circuit = self._dark.popleft()
            if circuit.closed_ns == closed_ns:
                self._circuits.pop(circuit.number, None)


class Steps:
    """A number that is changed from time to time."""

    def __init__(self, value: float) -> None:
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
        return max(self._between(first_ns, last_ns))

    def lowest(self, first_ns: int, last_ns: int) -> float:
        return min(self._between(first_ns, last_ns))

    def _between(self, first_ns: int, last_ns: int) -> list[float]:
        first, last = (bisect_right(self._since_ns, time_ns) - 1 for time_ns in (first_ns, last_ns))
        return self._values[first : last + 1]
