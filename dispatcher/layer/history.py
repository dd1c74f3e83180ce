"""The history of the qubits: remembered, written to the event log, and sent to watchers.

Noise models remember fibres to the same depth (dispatcher/fiber/noise.py).

In a capture every event is a packet on the interface where it happened. Interfaces are the fibres,
named `fiber alice-q0` after their host's end, or after both ends between two switches; what happens
at no fibre is on the interface `dispatcher`.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import IO, TextIO

from dispatcher.fiber.noise import NoiseHistory
from dispatcher.layer.journal import causer
from wire.config import Fiber
from wire.dispatcher_pb2 import Event
from wire.events import DROPPED, UNWRITTEN, encode_record, format_line
from wire.pcapng import LINKTYPE_USER0, Interface, Packet, Writer

WATCHER_DEPTH = 10_000
MOST_AT_ONCE = 1_000  # to a watcher in one message
MOST_EVENTS = 32_000_000  # written of all: some 8 GB
WATCHED_PHOTONS = 1_000  # of a block, for a watcher who asks for them
ELSEWHERE = "dispatcher"
MOST_UNWRITTEN = 1_000


class EventCapture:
    def __init__(self, file: IO[bytes], fibers: Sequence[Fiber]) -> None:
        names = [ELSEWHERE, *(fiber_name(fiber) for fiber in fibers)]
        self._file = file
        self._writer = Writer(file, [Interface(name, LINKTYPE_USER0) for name in names])
        self._interfaces = {
            (end.node, end.port): number
            for number, fiber in enumerate(fibers, 1)
            for end in (fiber.a, fiber.b)
        }
        file.flush()

    def record(self, *events: Event) -> None:
        """Write events; a reader sees them at once."""
        for event in events:
            data = encode_record(event)
            interface = self._interfaces.get((event.node, event.port), 0)
            self._writer.write(Packet(event.time_ns, data, len(data), interface))
        self._file.flush()


def fiber_name(fiber: Fiber) -> str:
    hosts = [end.port for end in (fiber.a, fiber.b) if not end.port.isdigit()]
    ends = hosts or [f"{end.node}:{end.port}" for end in (fiber.a, fiber.b)]
    return f"fiber {' '.join(ends)}"


class Watcher:
    """One reader of events; it loses some when it is slow, and learns how many."""

    def __init__(self, node: str, session: int, per_qubit: bool = False) -> None:
        """Watch a node (empty: all) and a session (0: all), also photon by photon if wanted."""
        self._node, self._session, self.per_qubit = node, session, per_qubit
        self._events: deque[Event] = deque()
        self._dropped = 0
        self._some = asyncio.Event()

    def wants(self, event: Event) -> bool:
        return (not self._node or event.node == self._node) and (
            not self._session or event.block.session == self._session
        )

    def push(self, event: Event) -> bool:
        """Queue an event; if the queue is full, count it as dropped and return False."""
        if not self.wants(event):
            return True
        has_capacity = len(self._events) < WATCHER_DEPTH
        if has_capacity:
            self._report_dropped(event.time_ns)
            self._events.append(event)
        else:
            self._dropped += 1
        self._some.set()
        return has_capacity

    @property
    def idle(self) -> bool:
        return not self._events

    async def next(self) -> Event:
        while not self._events:
            self._some.clear()
            await self._some.wait()
        event = self._events.popleft()
        if not self._events:
            self._report_dropped(event.time_ns)
        return event

    async def some(self) -> list[Event]:
        """Wait for the next event; return it and those that are there behind it."""
        events = [await self.next()]
        while self._events and len(events) < MOST_AT_ONCE:
            events.append(await self.next())
        return events

    def _report_dropped(self, time_ns: int) -> None:
        if self._dropped:
            detail = f"{self._dropped} events, because this watcher is slow"
            self._dropped = 0
            self._events.append(
                Event(time_ns=time_ns, node="dispatcher", kind=DROPPED, detail=detail)
            )


class History:
    """The last events, and everyone who wants to hear of new ones."""

    def __init__(
        self,
        depth: int,
        log: TextIO | None = None,
        capture: EventCapture | None = None,
        photons: int = 0,
        share: int = MOST_EVENTS,
        delay_s: float = 0.0,
    ) -> None:
        """Remember `depth` events; write each to `log` as a line, to `capture` as a packet.

        With a delay they are written a moment later, when those who wait have their answers: of an
        event loop, whose last ones `write_out` writes.

        The events of the first `photons` photons of each block are written, too. Of what one node
        causes, at any node, at most `share` events are written, and then a last one that says so.
        """
        self._unwritten: list[Event] = []  # yet
        self._fault: OSError | None = None  # in writing
        self._share, self._written = share, Counter[str]()  # events, by who has caused them
        self._photons = photons
        self.count = self.dropped = 0  # all events, and those that slow watchers have lost
        self._events: deque[Event] = deque(maxlen=depth)
        self._depth = depth
        self._pasts: dict[tuple[str, ...], NoiseHistory] = {}
        self._watchers: set[Watcher] = set()
        self._log, self._capture = log, capture
        self._delay_s = delay_s

    def record(self, *events: Event) -> None:
        """Add events; raise OSError if earlier ones could not be written."""
        self.count += len(events)
        self._events += events
        self._write(events)
        for watcher in self._watchers:
            self._tell(watcher, events)

    @property
    def photons_wanted(self) -> int:
        """Of how many photons of a block somebody wants to know each by itself."""
        watched = any(watcher.per_qubit for watcher in self._watchers)
        return max(self._photons, WATCHED_PHOTONS if watched else 0)

    def record_photons(self, events: Sequence[Event]) -> None:
        """Add events of the first photons of a block; they are not remembered."""
        self._write(events[: self._photons])
        for watcher in self._watchers:
            if watcher.per_qubit:
                self._tell(watcher, events[:WATCHED_PHOTONS])

    def _write(self, events: Sequence[Event]) -> None:
        if self._log is None and self._capture is None:
            return
        if self._fault is not None:
            raise self._fault
        events = self._within_share(events)
        if not events:
            return
        self._unwritten += events
        if self._delay_s and len(self._unwritten) < MOST_UNWRITTEN:
            if len(self._unwritten) == len(events):
                asyncio.get_running_loop().call_later(self._delay_s, self._write_soon)
        else:
            self.write_out()

    def _write_soon(self) -> None:
        try:
            self.write_out()
        except OSError as error:
            self._fault = error  # of the next event

    def write_out(self) -> None:
        """Write all events that there are into log and capture; raise OSError if that fails."""
        events, self._unwritten = self._unwritten, []
        if not events:
            return
        if self._log is not None:
            self._log.write("".join(f"{format_line(event)}\n" for event in events))
            self._log.flush()
        if self._capture is not None:
            self._capture.record(*events)

    def _within_share(self, events: Sequence[Event]) -> Sequence[Event]:
        """Return those of events that may be written: nobody fills the disk of all."""
        if not events:
            return events
        who = causer() or events[0].node
        free = self._share - self._written[who]
        self._written[who] += len(events)
        if len(events) <= free:
            return events
        if free < 0:
            return ()
        detail = f"more than {self._share} events caused by {who}, its share"
        last = Event(time_ns=events[0].time_ns, node="dispatcher", kind=UNWRITTEN, detail=detail)
        return *events[:free], last

    def _tell(self, watcher: Watcher, events: Sequence[Event]) -> None:
        for event in events:
            self.dropped += not watcher.push(event)

    def of_model(self, *place: str) -> NoiseHistory:
        """Return what has been remembered of a place: a fibre's direction and a noise model."""
        return self._pasts.setdefault(place, NoiseHistory(self._depth))

    @contextmanager
    def watching(
        self, node: str, session: int, remembered: bool, per_qubit: bool = False
    ) -> Iterator[Watcher]:
        """Give a watcher of new events, after those still remembered if these are wanted."""
        watcher = Watcher(node, session, per_qubit)
        for event in self._events if remembered else ():
            watcher.push(event)
        self._watchers.add(watcher)
        try:
            yield watcher
        finally:
            self._watchers.remove(watcher)
