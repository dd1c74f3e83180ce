"""The messages of a live view in the order in which they came to be known: a bounded list.

A message is an object of JSON with `t` (seconds since the origin) and `what`: an event of the
dispatcher, a fact of the controller's record, an act of the live view, the state of devices.
"""

from threading import Lock
from typing import Any

MOST_MESSAGES = 100_000
Message = dict[str, Any]


class Timeline:
    """Takes messages of several threads; each reader keeps its own position."""

    def __init__(self, origin_ns: int, most: int = MOST_MESSAGES) -> None:
        """Begin empty; the origin is on the clock of the captures."""
        self.origin_ns = origin_ns
        self.ended = False  # whether nothing comes any more
        # Number n is at n % most: readers get what is new without passing all that is old.
        self._messages: list[Message] = []
        self._most = most
        self._count = 0  # of all that have ever come
        self._lock = Lock()

    def add(self, what: str, time_ns: int, fields: dict[str, Any]) -> None:
        """Append a message."""
        seconds = round((time_ns - self.origin_ns) / 1e9, 9)
        message = {"t": seconds, "what": what, **fields}
        with self._lock:
            if self._count < self._most:
                self._messages.append(message)
            else:
                self._messages[self._count % self._most] = message
            self._count += 1

    def after(self, position: int, most: int) -> tuple[list[Message], int, int]:
        """Return messages behind a position, the position behind these, and how many were missed.

        Those missed had to make room for later ones.
        """
        with self._lock:
            first = self._count - len(self._messages)
            begin = min(max(position, first), self._count)
            end = min(begin + most, self._count)
            found = [self._messages[number % self._most] for number in range(begin, end)]
        return found, end, max(first - position, 0)
