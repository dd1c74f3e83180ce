"""Capture files: pcapng with named interfaces, and pcap, as tcpdump writes it.

    section header | interface | interface | ... | packet | packet | ...

All times are nanoseconds since 1970. Format: IETF draft-ietf-opsawg-pcapng, sections 4.1 to
4.3, and of decryption secrets, for the blocks, 3.5 for options; draft-ietf-opsawg-pcap for those
of tcpdump.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import IO, NamedTuple

from wire.malformed import MalformedPacket

LINKTYPE_ETHERNET = 1
LINKTYPE_USER0 = 147  # for private use: our events (wire.events)
MAX_PACKET_BYTES = 262_144  # tcpdump's own limit
_SECTION, _INTERFACE, _PACKET, _SECRETS = 0x0A0D0D0A, 1, 6, 10
_TLS_KEY_LOG = 0x544C534B
_BYTE_ORDER = 0x1A2B3C4D
_IF_NAME, _IF_TSRESOL, _USER_APPLICATION = 2, 9, 4
_NANOSECONDS = b"\x09"  # 10^-9 s
_BLOCK = struct.Struct("<II")
_LENGTH = struct.Struct("<I")
_SECTION_BODY = struct.Struct("<IHHq")
_INTERFACE_BODY = struct.Struct("<HHI")
_SECRETS_BODY = struct.Struct("<II")
_PACKET_BODY = struct.Struct("<IIIII")
_PACKET_HEAD = struct.Struct("<IIIIIII")  # of the block and of its body
TRAILER_BYTES = _LENGTH.size  # of a packet's block, behind data and padding
_PADDING = (b"", b"\0\0\0", b"\0\0", b"\0")
_HEADER = struct.Struct("<IHHi4sII")
_RECORD = struct.Struct("<IIII")
_MAGIC, _MAJOR, _MINOR = 0xA1B23C4D, 2, 4  # with nanoseconds
# In Reserved2, which all readers ignore: the packets have the time of a stepped network.
NETWORK_TIME = b"qmnN"
_SECOND_NS = 1_000_000_000


class Interface(NamedTuple):
    """Where packets were captured."""

    name: str
    link_type: int


class Packet(NamedTuple):
    time_ns: int
    data: bytes
    length: int  # on the wire; more than len(data) if it was cut
    interface: int = 0  # number of its interface in the file


class Writer:
    """Writes one section; its interfaces are known from the start."""

    def __init__(
        self, file: IO[bytes], interfaces: Sequence[Interface], key_log: bytes = b""
    ) -> None:
        """Write what comes before the packets, with what Wireshark needs to read TLS in them."""
        self._file = file
        application = _option(_USER_APPLICATION, b"qmn") + _option(0)
        file.write(_block(_SECTION, _SECTION_BODY.pack(_BYTE_ORDER, 1, 0, -1) + application))
        for interface in interfaces:
            options = _option(_IF_NAME, interface.name.encode())
            options += _option(_IF_TSRESOL, _NANOSECONDS) + _option(0)
            body = _INTERFACE_BODY.pack(interface.link_type, 0, MAX_PACKET_BYTES)
            file.write(_block(_INTERFACE, body + options))
        if key_log:
            body = _SECRETS_BODY.pack(_TLS_KEY_LOG, len(key_log)) + key_log
            file.write(_block(_SECRETS, body + _PADDING[len(key_log) & 3]))

    def write(self, packet: Packet) -> None:
        time_ns, data, length, interface = packet
        size = len(data)
        padding = _PADDING[size & 3]
        total = _PACKET_HEAD.size + size + len(padding) + _LENGTH.size
        high, low = time_ns >> 32, time_ns & 0xFFFFFFFF
        head = _PACKET_HEAD.pack(_PACKET, total, interface, high, low, size, length)
        self._file.write(b"".join((head, data, padding, _LENGTH.pack(total))))


@dataclass
class Reader:
    """Reads what Writer wrote; keeps its place, so that it can go on when more was written.

    A block that is not whole yet, because it is being written or its writer was killed, is
    left for the next time.
    """

    file: IO[bytes]

    def __post_init__(self) -> None:
        self.interfaces: list[Interface] = []
        self._begun = False

    def packets(self) -> Iterator[Packet]:
        """Yield the packets that have come since the last time."""
        while (block := self._next_block()) is not None:
            kind, body = block
            if not self._begun:
                self._begin(kind, body)
            elif kind == _INTERFACE:
                self.interfaces.append(_read_interface(body))
            elif kind == _PACKET:
                yield self._read_packet(body)

    def _next_block(self) -> tuple[int, bytes] | None:
        place = self.file.tell()
        head = self.file.read(_BLOCK.size)
        if not self._begun and not _LENGTH.pack(_SECTION).startswith(head[:4]):
            raise MalformedPacket(f"not a pcapng file of ours: begins with {head.hex()}")
        if len(head) == _BLOCK.size:
            kind, total = _BLOCK.unpack(head)
            if total % 4 or not 12 <= total <= MAX_PACKET_BYTES + 4096:
                raise MalformedPacket(f"not a pcapng file of ours: a block of {total} bytes")
            rest = self.file.read(total - _BLOCK.size)
            if len(rest) == total - _BLOCK.size:
                if _LENGTH.unpack(rest[-4:]) != (total,):
                    raise MalformedPacket(f"pcapng: the block at byte {place} has two lengths")
                return kind, rest[:-4]
        self.file.seek(place)
        return None

    def _begin(self, kind: int, body: bytes) -> None:
        if kind != _SECTION or body[:4] != _LENGTH.pack(_BYTE_ORDER):
            raise MalformedPacket("not a pcapng file of ours: of another byte order")
        self._begun = True

    def _read_packet(self, body: bytes) -> Packet:
        if len(body) < _PACKET_BODY.size:
            raise MalformedPacket(f"pcapng: a packet block of {len(body)} bytes")
        interface, high, low, size, length = _PACKET_BODY.unpack_from(body)
        data = body[_PACKET_BODY.size : _PACKET_BODY.size + size]
        if len(data) != size or interface >= len(self.interfaces):
            raise MalformedPacket(f"pcapng: {size} bytes of interface {interface} do not fit")
        return Packet(high << 32 | low, data, length, interface)


class PcapWriter:
    """Writes a pcap file with nanoseconds, by the wall's clock or by a stepped network's."""

    def __init__(self, file: IO[bytes], link_type: int, network_time: bool = False) -> None:
        clock = NETWORK_TIME if network_time else bytes(4)
        file.write(_HEADER.pack(_MAGIC, _MAJOR, _MINOR, 0, clock, MAX_PACKET_BYTES, link_type))
        self._file = file

    def write(self, packet: Packet) -> None:
        time = divmod(packet.time_ns, _SECOND_NS)
        self._file.write(_RECORD.pack(*time, len(packet.data), packet.length) + packet.data)


class PcapReader:
    """Reads pcap files of either byte order, with micro- or nanoseconds."""

    _FILE = struct.Struct("IHHiIII")
    _UNITS_NS = {0xA1B2C3D4: 1000, 0xA1B23C4D: 1}  # noqa: RUF012

    def __init__(self, file: IO[bytes]) -> None:
        """Read the file's header; raise MalformedPacket if it has none."""
        self._file = file
        head = file.read(self._FILE.size)
        for order in "<>":
            magic = int.from_bytes(head[:4], "little" if order == "<" else "big")
            if len(head) == self._FILE.size and magic in self._UNITS_NS:
                self._unit_ns = self._UNITS_NS[magic]
                self._record = struct.Struct(f"{order}IIII")
                (link_type,) = struct.unpack_from(f"{order}I", head, 20)
                self.link_type = link_type & 0xFFFF
                self.network_time = head[12:16] == NETWORK_TIME  # else the wall's
                return
        raise MalformedPacket(f"not a pcap file: begins with {head[:4].hex()}")

    def packets(self, interface: int = 0) -> Iterator[Packet]:
        read, record, unit_ns = self._file.read, self._record, self._unit_ns
        while len(head := read(record.size)) == record.size:
            seconds, fraction, size, length = record.unpack(head)
            if size > MAX_PACKET_BYTES:
                raise MalformedPacket(f"pcap: a packet of {size} bytes")
            if len(data := read(size)) < size:
                return
            yield Packet(seconds * 1_000_000_000 + fraction * unit_ns, data, length, interface)


def _read_interface(body: bytes) -> Interface:
    if len(body) < _INTERFACE_BODY.size:
        raise MalformedPacket(f"pcapng: an interface block of {len(body)} bytes")
    link_type, _reserved, _limit = _INTERFACE_BODY.unpack_from(body)
    options = dict(_read_options(body[_INTERFACE_BODY.size :]))
    if options.get(_IF_TSRESOL) != _NANOSECONDS:
        raise MalformedPacket("pcapng: an interface without nanoseconds is not ours")
    return Interface(options.get(_IF_NAME, b"").decode(errors="replace"), link_type)


def _read_options(data: bytes) -> Iterator[tuple[int, bytes]]:
    while len(data) >= 4:
        code, size = struct.unpack_from("<HH", data)
        if code == 0:
            return
        yield code, data[4 : 4 + size]
        data = data[4 + size + (-size % 4) :]


def _block(kind: int, body: bytes) -> bytes:
    total = _BLOCK.size + len(body) + _LENGTH.size
    return _BLOCK.pack(kind, total) + body + _LENGTH.pack(total)


def _option(code: int, value: bytes = b"") -> bytes:
    return struct.pack("<HH", code, len(value)) + value + _PADDING[len(value) & 3]


def with_clock(source: IO[bytes], target: IO[bytes], ahead_ns: int) -> None:
    """Copy a pcap file whose clock was ahead by so much; raise MalformedPacket if it is not one."""
    reader = PcapReader(source)
    writer = PcapWriter(target, reader.link_type)
    for packet in reader.packets():
        writer.write(packet._replace(time_ns=packet.time_ns - ahead_ns))
