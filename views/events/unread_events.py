"""The count of events that the end of a network took from somebody who was still reading.

The dispatcher keeps some thousand events for a slow reader. When it ends they go with it, but the
file of the run has them all, in the same order: what is behind the last one read was missed.
"""

from pathlib import Path
from typing import Self

from wire.dispatcher_pb2 import Event, WatchRequest
from wire.events import DROPPED, decode_record
from wire.pcapng import LINKTYPE_USER0, Reader


class Unread:
    """Follows what was read, beside the file that has everything."""

    def __init__(self, file: Path, request: WatchRequest, since_ns: int) -> None:
        """Open the file now: a run without a folder of its own removes it at its end."""
        self._file = file.open("rb")
        self._request, self._since_ns = request, since_ns
        self._last: Event | None = None
        self._reported = 0  # of those behind the last one, already reported as dropped

    def read(self, event: Event) -> None:
        if event.photon:
            return  # of a block whose event has come, and not always in the file
        if event.kind == DROPPED:
            self._reported += dropped(event)
        else:
            self._last, self._reported = event, 0

    def end(self) -> Event | None:
        """Return the event that says how many were missed, if any."""
        missed, behind, time_ns = 0, self._last is None, 0
        reader = Reader(self._file)
        for packet in reader.packets():
            if reader.interfaces[packet.interface].link_type != LINKTYPE_USER0:
                continue
            if self._last is not None and packet.time_ns < self._last.time_ns and not behind:
                continue  # most are: no need to decode them
            event = decode_record(packet.data)
            if event == self._last:
                behind, missed = True, 0
            elif behind and self._wanted(event):
                missed, time_ns = missed + 1, event.time_ns
        missed -= self._reported
        if missed <= 0:
            return None
        detail = f"{missed} events, because the network ended before they were read"
        return Event(time_ns=time_ns, node="dispatcher", kind=DROPPED, detail=detail)

    def _wanted(self, event: Event) -> bool:
        request = self._request
        if event.photon:
            return False
        if self._last is None and not request.history and event.time_ns < self._since_ns:
            return False
        return (not request.node or event.node == request.node) and (
            not request.session or event.block.session == request.session
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._file.close()


def dropped(event: Event) -> int:
    return int(event.detail.split()[0])
