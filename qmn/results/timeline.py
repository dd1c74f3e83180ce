"""One timeline of a run: all packets and all quantum events in one file, in time order.

In stepped time the captures get the network's clock when the timeline is made. Packets of one
instant then have the same time, and the timeline alone has their order.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from qmn.results.time_order import Place, in_time_order
from topologies.nodes.tls import KEY_LOGS
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.dissection.dissectors import install
from wire.leaps import LeapingClock
from wire.malformed import MalformedPacket
from wire.pcapng import (
    TRAILER_BYTES,
    Interface,
    Packet,
    PcapReader,
    PcapWriter,
    Reader,
    Writer,
)

TIMELINE = "all.pcapng"
MERGE_AT_MOST_BYTES = 500_000_000  # of captures, at the end of a run: a few seconds
WHOLE_AT_MOST_BYTES = 4_000_000  # of captures: of more, the timeline has the heads of packets
HEAD_BYTES = 128  # headers, and what quantum metadata begins with
LEAST_PCAP_BYTES = 24  # its header; a capture that was killed at its start has less


class NoCaptures(Exception):
    """A folder in which nothing was captured; the text names value and remedy."""


def timeline_of_run(run: Path) -> str:
    """Merge what was captured, beside dissectors for it; return the file, or why there is none.

    Of a long run it is not a second copy of everything: packets, whole in the captures, are cut.
    Nobody may write the captures any more: those of stepped time get the network's clock.
    """
    install(run)
    size = captured_bytes(run)
    if size > MERGE_AT_MOST_BYTES:
        text = f"not made, of {size / 1e6:,.0f} MB of captures, which keep the wall's clock"
        return f"{text}: `qmn wireshark {run}` makes it"
    packet_bytes = HEAD_BYTES if size > WHOLE_AT_MOST_BYTES else None
    try:
        return str(merge(run, packet_bytes=packet_bytes, rewrite=True))
    except (NoCaptures, MalformedPacket, OSError) as error:
        return f"not made: {error}"


def captured_bytes(run: Path) -> int:
    return sum(file.stat().st_size for file in _captures(run))


def merge(
    run: Path, target: Path | None = None, packet_bytes: int | None = None, rewrite: bool = False
) -> Path:
    """Write the timeline of a run's folder, by default into it; return the file.

    It has at most `packet_bytes` of each packet; None: all that was captured. With `rewrite`,
    captures get the network's clock where it differs from that of the wall.

    Packets are on interfaces named after their capture files, events on those that they
    have in the dispatcher's file. Raise NoCaptures where there is nothing, MalformedPacket
    for a file that is not a capture, or has other packets than the timeline that has their order.
    """
    files = _captures(run)
    if not files:
        raise NoCaptures(
            f"no captures in {run}: name the folder of a run that has some, as all have but those "
            "made with --captures none"
        )
    target = target or run / TIMELINE
    with ExitStack() as stack:
        beside = Path(stack.enter_context(TemporaryDirectory(prefix=".", dir=target.parent)))
        captured = Captured(run, files, stack, beside)
        ordered = captured.in_order()
        moved = captured.moved if rewrite else set()
        copies = {number: beside / files[number].name for number in moved}
        _write(captured, ordered, beside / target.name, packet_bytes, copies)
        (beside / target.name).replace(target)  # first: it alone has the order within an instant
        for number, copy in copies.items():
            copy.replace(files[number])
    return target


def _write(
    captured: "Captured",
    ordered: Iterator[Place],
    target: Path,
    packet_bytes: int | None,
    copies: dict[int, Path],
) -> None:
    """Write a timeline, and copies of captures, by their number, on the network's clock."""
    with ExitStack() as stack:
        output = stack.enter_context(_begin(target))
        writer = Writer(output, captured.interfaces, key_log(captured.run))
        writers = {
            number: PcapWriter(
                stack.enter_context(_begin(file)),
                captured.interfaces[number].link_type,
                network_time=True,
            )
            for number, file in copies.items()
        }
        for place in ordered:
            packet = captured.packet(place)
            if place.file in writers:
                writers[place.file].write(packet)
            if place.file < captured.pcaps:
                packet = packet._replace(data=packet.data[:packet_bytes])
            writer.write(packet)


class Captured:
    """The captures of a run, and behind them its events."""

    def __init__(self, run: Path, files: Sequence[Path], stack: ExitStack, beside: Path) -> None:
        """Open them; notes are put into a folder meanwhile."""
        self.run, self._stack, self._beside = run, stack, beside
        self._files = [stack.enter_context(file.open("rb")) for file in files]
        self._readers = [
            PcapReader(opened)
            for file, opened in zip(files, self._files, strict=True)
            if file.suffix == ".pcap"
        ]
        self.pcaps = len(self._readers)
        self._clock = LeapingClock(run)
        self.moved: set[int] = set()  # captures to which the network's clock gives other times
        self.interfaces = [
            Interface(file.stem, reader.link_type)
            for file, reader in zip(files, self._readers, strict=False)
        ]

    def in_order(self) -> Iterator[Place]:
        """Return where all packets are, by time; all have been read when it returns."""
        parts = [self._packets(number) for number in range(self.pcaps)]
        parts += [self._events(number) for number in range(self.pcaps, len(self._files))]
        rewritten = {n for n, reader in enumerate(self._readers) if reader.network_time}
        if not rewritten:
            return self._sorted(chain.from_iterable(parts))
        timeline = self.run / TIMELINE
        if not timeline.exists():
            raise NoCaptures(
                f"{timeline} is gone, which had the order of packets that have one time; without "
                f"it: `mergecap -w {TIMELINE} *.pcap {EVENT_CAPTURE}` there"
            )
        file = self._stack.enter_context(timeline.open("rb"))
        return self._as_in(
            file,
            [
                part if number in rewritten else self._sorted(part, number)
                for number, part in enumerate(parts)
            ],
        )

    def _as_in(self, timeline: IO[bytes], parts: Sequence[Iterator[Place]]) -> Iterator[Place]:
        """Yield places in the order of a timeline that was made of the same packets."""
        reader = Reader(timeline)
        for packet in reader.packets():
            place = next(parts[min(packet.interface, len(parts) - 1)], None)
            if place is None or (place.interface, place.time_ns) != (
                packet.interface,
                packet.time_ns,
            ):
                break
            yield place
        else:
            same = reader.interfaces == self.interfaces
            if same and not any(next(part, None) for part in parts):
                return
        raise MalformedPacket(f"{self.run / TIMELINE} is not of the captures beside it")

    def packet(self, place: Place) -> Packet:
        data = os.pread(self._files[place.file].fileno(), place.size, place.offset)
        return Packet(place.time_ns, data, place.length, place.interface)

    def _sorted(self, places: Iterator[Place], number: int = 0) -> Iterator[Place]:
        notes = self._beside / f"notes-{number}"
        return in_time_order(places, self._stack.enter_context(notes.open("x+b")))

    def _packets(self, number: int) -> Iterator[Place]:
        file, reader = self._files[number], self._readers[number]
        network_ns = self._clock.of(reader)
        for captured_ns, data, length, _interface in reader.packets():
            time_ns, size = network_ns(captured_ns), len(data)
            if time_ns != captured_ns:
                self.moved.add(number)
            offset = file.tell() - size
            yield Place(time_ns, captured_ns, number, number, offset, size, length)

    def _events(self, number: int) -> Iterator[Place]:
        file, first = self._files[number], len(self.interfaces)
        events = Reader(file)
        for time_ns, data, length, interface in events.packets():
            end = file.tell() - TRAILER_BYTES - (-len(data) % 4)
            yield Place(time_ns, 0, first + interface, number, end - len(data), len(data), length)
        self.interfaces += events.interfaces


def key_log(run: Path) -> bytes:
    """Return the secrets by which Wireshark reads what went by TLS; empty: nothing did."""
    return b"".join(file.read_bytes() for file in sorted(run.glob(KEY_LOGS)))


def _begin(file: Path) -> IO[bytes]:
    """Open a new file that only its owner can read."""
    file.touch(mode=0o600, exist_ok=False)
    return file.open("wb")


def _captures(run: Path) -> list[Path]:
    files = [*sorted(run.glob("*.pcap")), run / EVENT_CAPTURE]
    return [file for file in files if file.exists() and file.stat().st_size >= LEAST_PCAP_BYTES]
