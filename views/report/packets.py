"""Quantum metadata and OpenFlow as the captures of a run hold them, from the first set-up on.

Metadata on its way from one host to another is in two captures: that of the sender's link and
that of the receiver's. The difference is what the network, and the controller that holds a
set-up message, have taken.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from views.report.streams import Flow, framed
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode, message_length
from wire.metadata.header import MAGIC, METADATA_PORT, VERSION, Message
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.results.run_result import NetworkFacts

_OPENFLOW = struct.Struct("!BBHI")  # version, type, length, transaction
OPENFLOW_1_4 = 5
_SETUP = struct.pack("!HBBI", MAGIC, VERSION, Setup.KIND, SETUP_LENGTH)


@dataclass(frozen=True)
class Flight:
    """A metadata message and when it left one host and reached another, on the captures' clock."""

    message: Message  # as it arrived, if it did: the controller writes into set-up messages
    sender: str
    receiver: str
    left_ns: int
    arrived_ns: int | None


def flights(folder: Path, network: NetworkFacts, limit: int, since_ns: int = 0) -> list[Flight]:
    """Return the first messages between hosts in the captures of a run, by when they left.

    At most `limit` are taken from each capture, from a time on: a figure shows a beginning.
    """
    hosts = {address: host for host, address in network.addresses.items()}
    left: dict[tuple[Flow, int], tuple[int, Message]] = {}
    arrived: dict[tuple[Flow, int], tuple[int, Message]] = {}
    with_light = {end.node for fiber in network.fibers for end in (fiber.a, fiber.b)}
    for file in sorted(folder.glob("*.pcap")):
        host = network.host_at(file.stem)
        if host not in with_light:
            continue  # the dispatcher's capture is the longest, and has no metadata
        later = (each for each in messages(file) if each[0] >= since_ns)
        for time_ns, flow, sequence, message in islice(later, limit):
            if hosts.get(flow.source) == host:
                left[flow, sequence] = time_ns, message
            elif hosts.get(flow.target) == host:
                arrived[flow, sequence] = time_ns, message
    made = []
    for key, (left_ns, message) in left.items():
        flow, _sequence = key
        if flow.target not in hosts:
            continue
        arrived_ns, last = arrived.get(key, (None, message))
        made.append(Flight(last, hosts[flow.source], hosts[flow.target], left_ns, arrived_ns))
    return sorted(made, key=lambda flight: flight.left_ns)


def messages(file: Path) -> Iterator[tuple[int, Flow, int, Message]]:
    for time_ns, flow, sequence, data in framed(file, METADATA_PORT, message_length):
        try:
            yield time_ns, flow, sequence, decode(data)
        except MalformedPacket:
            continue  # Wireshark shows it; a diagram has no place for it


def openflow(file: Path, port: int) -> Iterator[tuple[int, Flow, bytes]]:
    """Yield time, direction and bytes of all whole OpenFlow messages."""
    for time_ns, flow, _sequence, data in framed(file, port, _openflow_length):
        yield time_ns, flow, data


def _openflow_length(data: bytes) -> int | None:
    if len(data) < _OPENFLOW.size:
        return None
    version, _kind, length, _xid = _OPENFLOW.unpack_from(data)
    if version != OPENFLOW_1_4 or length < _OPENFLOW.size:
        raise MalformedPacket(f"not OpenFlow 1.4: {data[:8].hex()}")
    return int(length)


def holds_setup(data: bytes) -> bool:
    """Return whether bytes hold a set-up message, as those of a packet-in may."""
    return _SETUP in data
