"""Capture files, checked by Wireshark's own tools."""

import io
import struct
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from limits import SOON_S
from scapy.layers.inet import IP, UDP
from scapy.layers.l2 import Ether
from scapy.utils import PcapWriter, RawPcapNgReader

from wire.malformed import MalformedPacket
from wire.pcapng import (
    LINKTYPE_ETHERNET,
    LINKTYPE_USER0,
    MAX_PACKET_BYTES,
    Interface,
    Packet,
    PcapReader,
    Reader,
    Writer,
)

TIME_NS = 1_700_000_000_123_456_789
DECRYPTION_SECRETS = 0xA  # type of the block, draft-ietf-opsawg-pcapng, 4.7
INTERFACES = [Interface("s1-eth1", LINKTYPE_ETHERNET), Interface("fiber alice-q0", LINKTYPE_USER0)]
FRAME = bytes(Ether(src="02:00:00:00:00:01", dst="02:00:00:00:00:02") / IP() / UDP() / b"x")
PACKETS = [
    Packet(TIME_NS, FRAME, len(FRAME), 0),
    *(Packet(TIME_NS + 1 + size, b"abcd"[:size], size, 1) for size in range(5)),
]


def written() -> bytes:
    file = io.BytesIO()
    writer = Writer(file, INTERFACES)
    for packet in PACKETS:
        writer.write(packet)
    return file.getvalue()


def tool(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
    assert "appears to" not in done.stderr
    return done.stdout


def test_capinfos_finds_names_nanoseconds_and_order(tmp_path: Path) -> None:
    file = tmp_path / "a.pcapng"
    file.write_bytes(written())
    report = tool("capinfos", str(file))
    for words in (
        "Name = s1-eth1",
        "Name = fiber alice-q0",
        "Encapsulation = USER 0",
        "Time precision = nanoseconds (9)",
        "Strict time order:   True",
        "Number of packets:   6",
        "2023-11-14 22:13:20.123456789",
    ):
        assert words in report, report


def test_tshark_reads_times_and_bytes(tmp_path: Path) -> None:
    file = tmp_path / "a.pcapng"
    file.write_bytes(written())
    fields = ["-e", "frame.time_epoch", "-e", "frame.interface_name", "-e", "frame.len"]
    lines = tool("tshark", "-r", str(file), "-T", "fields", *fields).splitlines()
    assert [line.split("\t") for line in lines] == [
        [f"1700000000.{packet.time_ns % 10**9}", INTERFACES[packet.interface].name, str(packet[2])]
        for packet in PACKETS
    ]


def test_scapy_reads_the_same_packets(tmp_path: Path) -> None:
    file = tmp_path / "a.pcapng"
    file.write_bytes(written())
    with RawPcapNgReader(str(file)) as packets:
        assert [data for data, _metadata in packets] == [packet.data for packet in PACKETS]


def test_what_is_written_is_read() -> None:
    reader = Reader(io.BytesIO(written()))
    assert list(reader.packets()) == PACKETS
    assert reader.interfaces == INTERFACES


def test_a_reader_goes_on_when_more_was_written() -> None:
    whole = written()
    file = io.BytesIO()
    reader, seen = Reader(file), []
    for number in range(len(whole)):
        place = file.tell()
        file.seek(0, io.SEEK_END)
        file.write(whole[number : number + 1])
        file.seek(place)
        seen += list(reader.packets())
    assert seen == PACKETS


def test_a_file_that_is_none_is_refused() -> None:
    whole = written()
    for data in (b"\xd4\xc3\xb2\xa1" + bytes(40), bytes(40), b"text " * 20, whole[28:]):
        with pytest.raises(MalformedPacket):
            list(Reader(io.BytesIO(data)).packets())


@pytest.mark.parametrize("length", [0, 4, 8, 13, 14, 15, 17, MAX_PACKET_BYTES + 4100])
def test_a_block_of_a_length_that_none_has_is_refused(length: int) -> None:
    """A block has 12 bytes at least, in words of four (draft-ietf-opsawg-pcapng, 3.1)."""
    size = length.to_bytes(4, "little")
    block = (b"\x06\0\0\0" + size).ljust(length - 4, b"\0") + size
    found = Reader(io.BytesIO(written() + block)).packets()
    assert [next(found) for _ in PACKETS] == PACKETS
    with pytest.raises(MalformedPacket, match=f"a block of {length} bytes"):
        next(found)


def test_a_changed_byte_changes_no_other_packet_than_its_own() -> None:
    """The packets before a refusal are as they were written, but for the changed block."""
    whole, ends = written(), block_ends(written())
    first = len(ends) - len(PACKETS)  # the blocks before are of the section and its interfaces
    outcomes = Counter[str]()
    for place in range(len(whole)):
        spoiled = bytearray(whole)
        spoiled[place] ^= 0xFF
        own = sum(end <= place for end in ends) - first
        packets = []
        try:
            for packet in Reader(io.BytesIO(bytes(spoiled))).packets():
                packets.append(packet)
        except MalformedPacket:
            outcomes["refused"] += 1
        else:
            outcomes["read"] += 1
        assert packets[: max(own, 0)] == PACKETS[: max(own, 0)]
        if len(packets) == len(PACKETS):
            assert packets[own + 1 :] == PACKETS[own + 1 :] or own < 0
    assert min(outcomes.values()) > 50, outcomes


def block_ends(data: bytes) -> list[int]:
    """Return where each block of a capture ends, by the lengths that they begin with."""
    ends = [0]
    while ends[-1] < len(data):
        ends.append(ends[-1] + int.from_bytes(data[ends[-1] + 4 : ends[-1] + 8], "little"))
    return ends[1:]


@pytest.mark.parametrize("nano", [True, False])
@pytest.mark.parametrize("order", ["<", ">"])
def test_pcap_of_either_kind_is_read(tmp_path: Path, nano: bool, order: str) -> None:
    file = tmp_path / "a.pcap"
    with PcapWriter(str(file), linktype=1, endianness=order, nano=nano) as writer:
        writer.write_header(None)
        writer.write_packet(FRAME, sec=1_700_000_000, usec=123_456, caplen=len(FRAME))
    with file.open("rb") as opened:
        reader = PcapReader(opened)
        fraction_ns = 123_456 if nano else 123_456_000
        packet = Packet(1_700_000_000 * 10**9 + fraction_ns, FRAME, len(FRAME), 3)
        assert list(reader.packets(3)) == [packet]
        assert reader.link_type == 1


def test_a_cut_pcap_gives_its_whole_packets(tmp_path: Path) -> None:
    file = tmp_path / "a.pcap"
    with PcapWriter(str(file), linktype=1, nano=True) as writer:
        writer.write_header(None)
        for _ in range(2):
            writer.write_packet(FRAME, sec=1, usec=2, caplen=len(FRAME))
    whole = file.read_bytes()
    record = 16 + len(FRAME)
    for size in range(24, len(whole)):
        reader = PcapReader(io.BytesIO(whole[:size]))
        assert len(list(reader.packets())) == (size - 24) // record
    with pytest.raises(MalformedPacket):
        PcapReader(io.BytesIO(whole[:23]))


def test_a_key_log_is_where_wireshark_looks_for_it(tmp_path: Path) -> None:
    """The block of secrets is that which Wireshark's own program writes."""
    secrets = b"CLIENT_RANDOM " + 64 * b"a" + b" " + 96 * b"b" + b"\n"
    file, plain, theirs = (tmp_path / name for name in ("a.pcapng", "b.pcapng", "c.pcapng"))
    (tmp_path / "keys").write_bytes(secrets)
    for made, report in ((file, [secrets]), (plain, list[bytes]())):
        with made.open("wb") as output:
            Writer(output, INTERFACES, *report).write(PACKETS[0])
    tool("editcap", "--inject-secrets", f"tls,{tmp_path / 'keys'}", str(plain), str(theirs))
    whole = theirs.read_bytes()
    begin = whole.index(struct.pack("<I", DECRYPTION_SECRETS))
    (length,) = struct.unpack_from("<I", whole, begin + 4)
    assert secrets in (block := whole[begin : begin + length])
    assert block in file.read_bytes()
    with file.open("rb") as opened:
        assert list(Reader(opened).packets()) == PACKETS[:1]
