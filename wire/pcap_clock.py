"""A capture by another clock: what tcpdump on one machine has written, as another would have."""

import struct
from typing import IO

from wire.pcapng import MAX_PACKET_BYTES, PcapReader

_HEADER = struct.Struct("<IHHiIII")
_RECORD = struct.Struct("<IIII")
_MAGIC, _MAJOR, _MINOR = 0xA1B23C4D, 2, 4  # with nanoseconds
_SECOND_NS = 1_000_000_000


def with_clock(source: IO[bytes], target: IO[bytes], ahead_ns: int) -> None:
    """Copy a pcap file whose clock was ahead by so much; raise MalformedPacket if it is none."""
    reader = PcapReader(source)
    target.write(_HEADER.pack(_MAGIC, _MAJOR, _MINOR, 0, 0, MAX_PACKET_BYTES, reader.link_type))
    for packet in reader.packets():
        time = divmod(packet.time_ns - ahead_ns, _SECOND_NS)
        target.write(_RECORD.pack(*time, len(packet.data), packet.length) + packet.data)
