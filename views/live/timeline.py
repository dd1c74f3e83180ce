"""The messages of a live view in the order in which they came to be known: a bounded list.

A message is an object of JSON with `t` (seconds since the origin) and `what`: an event of the
dispatcher, a fact of the controller's record, an act of the live view, the state of devices.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

from wire.dispatcher_pb2 import Event
from wire.events import fields_text

MOST_MESSAGES = 100_000
ENCODED = json.JSONEncoder(separators=(",", ":")).encode


class Timeline:
    """Takes messages of several threads; each reader keeps its own position.

    They are kept as text, which is the same for all readers.
    """

    def __init__(self, origin_ns: int, most: int = MOST_MESSAGES) -> None:
        """Begin empty; the origin is on the clock of the captures."""
        self.origin_ns = origin_ns
        self.ended = False  # whether nothing comes any more
        # Number n is at n % most: readers get what is new without passing all that is old.
        self._messages: list[str] = []
        self._most = most
        self._count = 0  # of all that have ever come
        self._lock = Lock()
        self._waiting: list[Callable[[], object]] = []

    def add(self, what: str, time_ns: int, fields: dict[str, Any]) -> None:
        self.add_all(what, [(time_ns, fields)])

    def add_all(self, what: str, happened: Iterable[tuple[int, dict[str, Any]]]) -> None:
        """Append messages, each with its time: readers get them together."""
        self._append([self._text(what, time_ns, fields) for time_ns, fields in happened])

    def add_events(self, what: str, events: Iterable[Event]) -> None:
        """Append events of the dispatcher likewise: they are most of what there is."""
        self._append(
            [
                f'{{"t":{self._seconds(event.time_ns)},"what":"{what}",{fields_text(event)}}}'
                for event in events
            ]
        )

    def _append(self, texts: list[str]) -> None:
        with self._lock:
            for text in texts:
                if self._count < self._most:
                    self._messages.append(text)
                else:
                    self._messages[self._count % self._most] = text
                self._count += 1
            self._tell()

    def _text(self, what: str, time_ns: int, fields: dict[str, Any]) -> str:
        return ENCODED({"t": self._seconds(time_ns), "what": what, **fields})

    def _seconds(self, time_ns: int) -> float:
        """Return the time since the origin; 0 for what came before it."""
        return round(max(time_ns - self.origin_ns, 0) / 1e9, 9)

    def end(self) -> None:
        with self._lock:
            self.ended = True
            self._tell()

    def _tell(self) -> None:
        for wake in self._waiting:
            wake()

    @contextmanager
    def telling(self, wake: Callable[[], object]) -> Iterator[None]:
        """Call this, in any thread, when there is more, or the end, as long as this lasts."""
        with self._lock:
            self._waiting.append(wake)
        try:
            yield
        finally:
            with self._lock:
                self._waiting.remove(wake)

    def after(self, position: int, most: int) -> tuple[list[str], int, int]:
        """Return messages behind a position, the position behind these, and how many were missed.

        Those missed had to make room for later ones.
        """
        with self._lock:
            first = self._count - len(self._messages)
            begin = min(max(position, first), self._count)
            end = min(begin + most, self._count)
            messages = [self._messages[number % self._most] for number in range(begin, end)]
        return messages, end, max(first - position, 0)
