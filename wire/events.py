"""The quantum event log: one line of text for each event of the dispatcher."""

from datetime import UTC, datetime
from functools import lru_cache

from wire.dispatcher_pb2 import Event


def format_line(event: Event) -> str:
    """Return the event as one line; its time is that of the packet captures, in UTC."""
    seconds, nanoseconds = divmod(event.time_ns, 1_000_000_000)
    parts = [f"{_moment(seconds)}.{nanoseconds:09d}Z", f"{event.node:<8}", f"{event.kind:<13}"]
    if event.HasField("block"):
        block = event.block
        parts.append(f"session={block.session:016x} block={block.number}/{block.half}")
    if event.port:
        parts.append(f"port={event.port}")
    if event.photons:
        parts.append(f"photons={event.photons}")
    if event.lost:
        parts.append(f"lost={event.lost}")
    if event.detail:
        parts.append(event.detail)
    return " ".join(parts)


@lru_cache(maxsize=2)
def _moment(seconds: int) -> str:
    """Return a second of the clock; thousands of events share one."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")
