"""One timeline of a run: all packets and all quantum events in one file, in time order.

Packets of several captures in the order of time, in memory that does not grow with their number.

The place of each packet is noted in 40 bytes; notes are sorted in batches, each put into a file,
and the sorted parts are then read beside each other.
"""

import heapq
import os
import struct
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import islice, pairwise
from pathlib import Path
from typing import IO, NamedTuple

from topologies.nodes.tls import KEY_LOGS
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.dissection.dissectors import install
from wire.leaps import LeapingClock
from wire.malformed import MalformedPacket
from wire.pcapng import TRAILER_BYTES, Interface, Packet, PcapReader, Reader, Writer

# Big-endian, so that the bytes of notes sort as their fields do.
NOTE = struct.Struct("!QQIIQII")
SORTED_AT_ONCE = 50_000  # notes: some 6 MB
TIMELINE = "all.pcapng"
MERGE_AT_MOST_BYTES = 500_000_000  # of captures, at the end of a run: a few seconds
WHOLE_AT_MOST_BYTES = 4_000_000  # of captures: of more, the timeline has the heads of packets
HEAD_BYTES = 128  # headers, and what quantum metadata begins with
LEAST_PCAP_BYTES = 24  # its header; a capture that was killed at its start has less


class Place(NamedTuple):
    """Where a packet's bytes are; places sort by time, then by order of interfaces."""

    time_ns: int
    wall_ns: int  # 0 of events: in stepped time, a packet is captured in an instant, behind these
    interface: int
    file: int
    offset: int
    size: int  # bytes there
    length: int  # of the packet, before it was cut


def in_time_order(
    places: Iterable[Place], file: IO[bytes], at_once: int = SORTED_AT_ONCE
) -> Iterator[Place]:
    """Return places by time; all have been read when it returns.

    The file, which is empty, holds those that memory shall not, and is read as they are yielded.
    """
    notes = (NOTE.pack(*place) for place in places)
    begins = [0]
    while part := sorted(islice(notes, at_once)):
        file.write(b"".join(part))
        begins.append(begins[-1] + len(part))
    each = max(1, at_once // len(begins))  # of each part: together as many as before
    parts = [_read(file, begin, end, each) for begin, end in pairwise(begins)]
    return (Place(*NOTE.unpack(note)) for note in heapq.merge(*parts))


def _read(file: IO[bytes], begin: int, end: int, at_once: int) -> Iterator[bytes]:
    """Yield the notes of a sorted part, read a few at a time."""
    for first in range(begin, end, at_once):
        file.seek(first * NOTE.size)
        data = file.read(min(at_once, end - first) * NOTE.size)
        for offset in range(0, len(data), NOTE.size):
            yield data[offset : offset + NOTE.size]


class NoCaptures(Exception):
    """A folder in which nothing was captured; the text names value and remedy."""


def timeline_of_run(run: Path) -> str:
    """Merge what was captured, beside dissectors for it; return the file, or why there is none.

    Of a long run it is not a second copy of everything: packets, whole in the captures, are cut.
    """
    install(run)
    size = captured_bytes(run)
    if size > MERGE_AT_MOST_BYTES:
        return f"not made, of {size / 1e6:,.0f} MB of captures: `qmn wireshark {run}` makes it"
    try:
        return str(merge(run, packet_bytes=HEAD_BYTES if size > WHOLE_AT_MOST_BYTES else None))
    except (NoCaptures, MalformedPacket, OSError) as error:
        return f"not made: {error}"


def captured_bytes(run: Path) -> int:
    return sum(file.stat().st_size for file in _captures(run))


def merge(run: Path, target: Path | None = None, packet_bytes: int | None = None) -> Path:
    """Write the timeline of a run's folder, by default into it; return the file.

    It has at most `packet_bytes` of each packet; None: all that was captured.

    Packets are on interfaces named after their capture files, events on those that they
    have in the dispatcher's file. Raise NoCaptures where there is nothing, MalformedPacket
    for a file that is not a capture.
    """
    captures = _captures(run)
    if not captures:
        raise NoCaptures(
            f"no captures in {run}: name the folder of a run that has some, as all have but those "
            "made with --captures none"
        )
    target = target or run / TIMELINE
    unfinished = target.with_name(f".{target.name}")
    interfaces: list[Interface] = []
    clock = LeapingClock(run)
    with ExitStack() as stack:
        files = [stack.enter_context(capture.open("rb")) for capture in captures]
        places = (
            place
            for number, (file, capture) in enumerate(zip(files, captures, strict=True))
            for place in _places(file, number, capture, interfaces, clock)
        )
        beside = stack.enter_context(tempfile.TemporaryFile(dir=target.parent))
        ordered = in_time_order(places, beside)
        unfinished.unlink(missing_ok=True)  # it may be a link
        unfinished.touch(mode=0o600, exist_ok=False)
        with unfinished.open("wb") as output:
            writer = Writer(output, interfaces, key_log(run))
            for time_ns, _wall_ns, interface, number, offset, size, length in ordered:
                if packet_bytes is not None and captures[number].suffix == ".pcap":
                    size = min(size, packet_bytes)
                data = os.pread(files[number].fileno(), size, offset)
                writer.write(Packet(time_ns, data, length, interface))
    unfinished.replace(target)
    return target


def key_log(run: Path) -> bytes:
    """Return the secrets by which Wireshark reads what went by TLS; empty: nothing did."""
    return b"".join(file.read_bytes() for file in sorted(run.glob(KEY_LOGS)))


def _places(
    file: IO[bytes], number: int, capture: Path, interfaces: list[Interface], clock: LeapingClock
) -> Iterator[Place]:
    """Yield where the packets of a file are; add its interfaces to the list."""
    first = len(interfaces)
    if capture.suffix == ".pcap":
        pcap = PcapReader(file)
        interfaces.append(Interface(capture.stem, pcap.link_type))
        for time_ns, data, length, _interface in pcap.packets():
            size = len(data)
            yield Place(clock.at(time_ns), time_ns, first, number, file.tell() - size, size, length)
        return
    events = Reader(file)
    for time_ns, data, length, interface in events.packets():
        end = file.tell() - TRAILER_BYTES - (-len(data) % 4)
        yield Place(time_ns, 0, first + interface, number, end - len(data), len(data), length)
    interfaces += events.interfaces


def _captures(run: Path) -> list[Path]:
    files = [*sorted(run.glob("*.pcap")), run / EVENT_CAPTURE]
    return [file for file in files if file.exists() and file.stat().st_size >= LEAST_PCAP_BYTES]
