"""Messages in the TCP streams of a capture, put together from segments in whatever order."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from wire.leaps import LeapingClock
from wire.malformed import MalformedPacket
from wire.pcapng import LINKTYPE_ETHERNET, Packet, PcapReader

_IPV4, _TCP = 0x0800, 6
_ETHERNET_BYTES = 14
MAX_PACKETS = 100_000  # looked at in each capture: a handshake is at its beginning
MAX_WAITING = 64  # segments behind a gap; with more, what is in it was not captured
LengthOf = Callable[[bytes], int | None]


class Segment(NamedTuple):
    time_ns: int
    source: str
    source_port: int
    target: str
    target_port: int
    sequence: int
    data: bytes


class Flow(NamedTuple):
    source: str
    source_port: int
    target: str
    target_port: int


def segments(file: Path) -> Iterator[Segment]:
    """Yield a capture's first TCP segments with data, by the network's time.

    Raise MalformedPacket for a file that is not a capture.
    """
    with file.open("rb") as opened:
        reader = PcapReader(opened)
        network_ns = LeapingClock(file.parent).of(reader)
        if reader.link_type != LINKTYPE_ETHERNET:
            raise MalformedPacket(f"{file.name}: link type {reader.link_type} is not Ethernet")
        for packet in islice(reader.packets(), MAX_PACKETS):
            segment = _segment(packet._replace(time_ns=network_ns(packet.time_ns)))
            if segment is not None:
                yield segment


def framed(file: Path, port: int, length_of: LengthOf) -> Iterator[tuple[int, Flow, int, bytes]]:
    """Yield the messages in the TCP streams from and to a port: time, direction, place, bytes.

    `length_of` returns the length of the message that its argument begins with, None if that is
    too short to tell, and raises MalformedPacket if it is not one.
    """
    streams: dict[Flow, _Stream] = {}
    for segment in segments(file):
        if port not in (segment.source_port, segment.target_port):
            continue
        flow = Flow(*segment[1:5])
        stream = streams.setdefault(flow, _Stream(segment.sequence))
        stream.add(segment)
        for time_ns, sequence, data in stream.messages(length_of):
            yield time_ns, flow, sequence, data
    for flow, stream in streams.items():
        while stream.waiting:
            stream.skip()
            for time_ns, sequence, data in stream.messages(length_of):
                yield time_ns, flow, sequence, data


@dataclass
class _Stream:
    """One direction of a connection. A switch may change the order of segments."""

    next: int  # sequence number
    begun: bytes = b""  # of a message that is not whole yet
    waiting: dict[int, Segment] = field(default_factory=dict)

    def add(self, segment: Segment) -> None:
        """Take a segment, which may be one that was seen before, or longer than that."""
        waiting = self.waiting.get(segment.sequence)
        if waiting is None or len(segment.data) > len(waiting.data):
            self.waiting[segment.sequence] = segment
        if len(self.waiting) > MAX_WAITING:
            self.skip()

    def skip(self) -> None:
        """Go on behind what was not captured."""
        self.next, self.begun = min(self.waiting, key=self._distance), b""

    def messages(self, length_of: LengthOf) -> Iterator[tuple[int, int, bytes]]:
        """Yield time, sequence number and bytes of what is whole by now."""
        for sequence in sorted(self.waiting, key=self._distance):
            seen = -self._distance(sequence)
            if seen < 0:
                return
            segment = self.waiting.pop(sequence)
            data, start = segment.data[seen:], self.next - len(self.begun)
            parts, self.begun = _split(self.begun + data, length_of)
            self.next = (self.next + len(data)) % 2**32
            for place, part in parts:
                yield segment.time_ns, (start + place) % 2**32, part

    def _distance(self, sequence: int) -> int:
        return (sequence - self.next + 2**31) % 2**32 - 2**31


def _split(data: bytes, length_of: LengthOf) -> tuple[list[tuple[int, bytes]], bytes]:
    """Return the whole messages with their places, and what is behind them if it begins one."""
    parts, place = [], 0
    try:
        while (length := length_of(data[place:])) and len(data) >= place + length:
            parts.append((place, data[place : place + length]))
            place += length
    except MalformedPacket:
        return parts, b""
    return parts, data[place:]


def _segment(packet: Packet) -> Segment | None:
    """Read Ethernet, IPv4 and TCP; None for anything else, for no data, for what was cut."""
    data = packet.data[_ETHERNET_BYTES:]
    if len(data) < 20 or struct.unpack_from("!H", packet.data, 12) != (_IPV4,):
        return None
    (total,) = struct.unpack_from("!H", data, 2)
    header = 4 * (data[0] & 15)
    if data[9] != _TCP or not header + 20 <= total <= len(data):
        return None
    source_port, target_port, sequence = struct.unpack_from("!HHI", data, header)
    payload = data[header + 4 * (data[header + 12] >> 4) : total]
    if not payload:
        return None
    source, target = str(IPv4Address(data[12:16])), str(IPv4Address(data[16:20]))
    return Segment(packet.time_ns, source, source_port, target, target_port, sequence, payload)
