"""Light entries that were let into the table, until the hardware has done them.

What the hardware is known to be unable to do is refused at FLOW_MOD or COMMIT. If it turns
out later, the controller that asked hears of it by an error with the xid of its message,
before its barrier is answered, and the entry is deleted.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol

from qswitch_agent.hardware.optics import CrossConnect

MAX_PROMISES = 4096  # an entry that the bridge itself has refused stays until then


class Asker(Protocol):
    """A controller's connection."""

    def fail(self, request: bytes, reason: str) -> None:
        """Answer a request of the controller with an error after all."""


Promise = tuple[Asker, bytes]  # who asked, and the message


class Promises:
    """All of one switch, by the cross-connect that each asks for."""

    def __init__(self) -> None:
        self._open: OrderedDict[CrossConnect, Promise] = OrderedDict()
        self.break_one: Callable[[CrossConnect], None] = lambda _path: None

    def __len__(self) -> int:
        return len(self._open)

    def add(self, path: CrossConnect, asker: Asker, request: bytes) -> None:
        self._open[path] = asker, request
        self._open.move_to_end(path)
        if len(self._open) > MAX_PROMISES:
            self._open.popitem(last=False)

    def due(self, paths: Iterable[CrossConnect]) -> list[CrossConnect]:
        return [path for path in paths if path in self._open]

    def settle(self, due: Iterable[CrossConnect], refused: Mapping[CrossConnect, str]) -> None:
        """The hardware has done what was due, but for what it has refused: answer that."""
        for path in due:
            promise = self._open.pop(path, None)
            if promise is not None and path in refused:
                self._break(path, *promise, refused[path])

    def give_up(self, asker: Asker, reason: str) -> None:
        """Answer all that a controller waits for: it cannot wait any longer."""
        for path, (other, request) in list(self._open.items()):
            if other is asker:
                del self._open[path]
                self._break(path, asker, request, reason)

    def _break(self, path: CrossConnect, asker: Asker, request: bytes, reason: str) -> None:
        asker.fail(request, reason)
        self.break_one(path)
