"""Writes every event as a packet of a capture, on the interface where it happened.

Interfaces are the fibres, named `fiber alice-q0` after their host's end, or after both ends
between two switches; what happens at no fibre is on the interface `dispatcher`.
"""

from collections.abc import Sequence
from typing import IO

from wire.config import Fiber
from wire.dispatcher_pb2 import Event
from wire.events import encode_record
from wire.pcapng import LINKTYPE_USER0, Interface, Packet, Writer

ELSEWHERE = "dispatcher"


class EventCapture:
    """A capture file that grows with every event."""

    def __init__(self, file: IO[bytes], fibers: Sequence[Fiber]) -> None:
        """Write the file's header."""
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
    """Return what the fibre's interface is called."""
    hosts = [end.port for end in (fiber.a, fiber.b) if not end.port.isdigit()]
    ends = hosts or [f"{end.node}:{end.port}" for end in (fiber.a, fiber.b)]
    return f"fiber {' '.join(ends)}"
