"""Quantum metadata and OpenFlow as the captures of a run hold them, from the first set-up on.

Metadata on its way from one host to another is in two captures: that of the sender's link and
that of the receiver's. The difference is what the network, and the controller that holds a
set-up message, have taken.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from ipaddress import IPv4Address
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from qmn.network_facts import NetworkFacts
from wire.metadata import (
    MAGIC,
    METADATA_PORT,
    SETUP_LENGTH,
    VERSION,
    MalformedPacket,
    Message,
    Setup,
    decode,
    message_length,
)
from wire.pcapng import LINKTYPE_ETHERNET, Packet, PcapReader

_IPV4, _TCP = 0x0800, 6
_ETHERNET_BYTES = 14
MAX_PACKETS = 100_000  # looked at in each capture: a handshake is at its beginning
_OPENFLOW = struct.Struct("!BBHI")  # version, type, length, transaction
OPENFLOW_1_4 = 5
_SETUP = struct.pack("!HBBI", MAGIC, VERSION, Setup.KIND, SETUP_LENGTH)


class Segment(NamedTuple):
    """A TCP segment with data."""

    time_ns: int
    source: str
    source_port: int
    target: str
    target_port: int
    sequence: int
    data: bytes


class Flow(NamedTuple):
    """One direction of a connection."""

    source: str
    source_port: int
    target: str
    target_port: int


@dataclass(frozen=True)
class Flight:
    """A metadata message and when it left one host and reached another, on the captures' clock."""

    message: Message  # as it arrived, if it did: the controller writes into set-up messages
    sender: str
    receiver: str
    left_ns: int
    arrived_ns: int | None


def segments(file: Path) -> Iterator[Segment]:
    """Yield the first TCP segments with data of a capture; raise MalformedPacket if it is none."""
    with file.open("rb") as opened:
        reader = PcapReader(opened)
        if reader.link_type != LINKTYPE_ETHERNET:
            raise MalformedPacket(f"{file.name}: link type {reader.link_type} is not Ethernet")
        for packet in islice(reader.packets(), MAX_PACKETS):
            segment = _segment(packet)
            if segment is not None:
                yield segment


def flights(folder: Path, network: NetworkFacts, limit: int) -> list[Flight]:
    """Return the first messages between hosts in the captures of a run, by when they left.

    At most `limit` are read from each capture: a report shows the beginning.
    """
    hosts = {address: host for host, address in network.addresses.items()}
    left: dict[tuple[Flow, int], tuple[int, Message]] = {}
    arrived: dict[tuple[Flow, int], tuple[int, Message]] = {}
    for file in sorted(folder.glob("*.pcap")):
        host = network.host_at(file.stem)
        if not host:
            continue
        for time_ns, flow, sequence, message in islice(messages(file), limit):
            if hosts.get(flow.source) == host:
                left[flow, sequence] = time_ns, message
            elif hosts.get(flow.target) == host:
                arrived[flow, sequence] = time_ns, message
    found = []
    for key, (left_ns, message) in left.items():
        flow, _sequence = key
        if flow.target not in hosts:
            continue
        arrived_ns, last = arrived.get(key, (None, message))
        ends = hosts[flow.source], hosts[flow.target]
        found.append(Flight(last, *ends, left_ns, arrived_ns))
    return sorted(found, key=lambda flight: flight.left_ns)


def messages(file: Path) -> Iterator[tuple[int, Flow, int, Message]]:
    """Yield time, direction, sequence number and message of all whole metadata messages."""
    for time_ns, flow, sequence, data in framed(file, METADATA_PORT, message_length):
        try:
            yield time_ns, flow, sequence, decode(data)
        except MalformedPacket:
            continue  # Wireshark shows it; a diagram has no place for it


def openflow(file: Path, port: int) -> Iterator[tuple[int, Flow, bytes]]:
    """Yield time, direction and bytes of all whole OpenFlow messages."""
    for time_ns, flow, _sequence, data in framed(file, port, _openflow_length):
        yield time_ns, flow, data


def framed(
    file: Path, port: int, length_of: Callable[[bytes], int | None]
) -> Iterator[tuple[int, Flow, int, bytes]]:
    """Yield the messages in the TCP streams from and to a port, put together from segments.

    `length_of` returns the length of the message that its argument begins with, None if that is
    too short to tell, and raises MalformedPacket if it is none.
    """
    streams: dict[Flow, tuple[int, bytes]] = {}
    for segment in segments(file):
        if port not in (segment.source_port, segment.target_port):
            continue
        flow = Flow(*segment[1:5])
        expected, held = streams.get(flow, (segment.sequence, b""))
        if segment.sequence != expected:
            if (expected - segment.sequence) % 2**32 < 2**31:
                continue  # a retransmission
            held = b""  # something was not captured: go on behind it
        data, start = held + segment.data, segment.sequence - len(held)
        parts, rest = _split(data, length_of)
        for place, part in parts:
            yield segment.time_ns, flow, (start + place) % 2**32, part
        streams[flow] = (segment.sequence + len(segment.data)) % 2**32, rest


def _split(
    data: bytes, length_of: Callable[[bytes], int | None]
) -> tuple[list[tuple[int, bytes]], bytes]:
    """Return the whole messages with their places, and what is behind them if it begins one."""
    parts, place = [], 0
    try:
        while (length := length_of(data[place:])) and len(data) >= place + length:
            parts.append((place, data[place : place + length]))
            place += length
    except MalformedPacket:
        return parts, b""
    return parts, data[place:]


def _openflow_length(data: bytes) -> int | None:
    if len(data) < _OPENFLOW.size:
        return None
    version, _kind, length, _xid = _OPENFLOW.unpack_from(data)
    if version != OPENFLOW_1_4 or length < _OPENFLOW.size:
        raise MalformedPacket(f"not OpenFlow 1.4: {data[:8].hex()}")
    return int(length)


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
    ends = str(IPv4Address(data[12:16])), source_port, str(IPv4Address(data[16:20])), target_port
    return Segment(packet.time_ns, *ends, sequence, payload)


def holds_setup(data: bytes) -> bool:
    """Return whether bytes hold a set-up message, as those of a packet-in may."""
    return _SETUP in data
