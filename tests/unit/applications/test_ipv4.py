"""IPv4 packets in a stream, and ICMP errors: RFC 791, 792, 1071; scapy as independent decoder."""

from ipaddress import IPv4Address
from typing import Any

import pytest
from scapy.layers.inet import ICMP, IP, UDP, IPerror
from scapy.packet import Packet as ScapyPacket

from applications.ip_over_light.ip_packet import PacketStream, decode, packet_bytes, unreachable
from applications.ip_over_light.ipv4 import HEADER
from applications.ip_over_light.lost_packet import Packet, Unreachable, checksum
from wire.malformed import MalformedPacket

MOST = 1500
ROUTER = IPv4Address("10.1.255.254")
ENDS = {"src": "10.1.0.1", "dst": "10.1.0.2"}


def made(payload: ScapyPacket, **header: Any) -> bytes:
    return bytes(IP(**{**ENDS, **header}) / payload)


def ping(size: int = 56) -> bytes:
    return made(ICMP() / bytes(size))


def read(data: bytes) -> Packet:
    return decode(data, MOST)


def test_a_packet_is_read_as_scapy_wrote_it() -> None:
    data = made(UDP(dport=53) / b"question", tos=4, ttl=9, options=[])
    packet = read(data)
    assert (packet.data, str(packet.source), str(packet.destination)) == (data, *ENDS.values())
    assert (packet.protocol, packet.first, packet.header_bytes) == (17, True, 20)


def test_golden_header_of_rfc_1071_has_the_check_that_others_compute() -> None:
    # 45 00 00 73 … is the example that textbooks sum: its check is b861.
    golden = bytes.fromhex("45000073000040004011b861c0a80001c0a800c7")
    assert checksum(golden) == 0
    assert checksum(golden[:10] + bytes(2) + golden[12:]) == 0xB861
    assert checksum(b"\x01") == 0xFEFF  # an odd byte is padded


@pytest.mark.parametrize("piece", [1, 7, 20, 83, 84, 85, 1000])
def test_packets_come_out_of_a_stream_however_it_is_cut(piece: int) -> None:
    packets = [ping(n) for n in (0, 56, 1, 1400, 13)]
    stream, data = PacketStream(MOST), b"".join(packets)
    found = []
    for start in range(0, len(data), piece):
        found += [packet.data for packet in stream.feed(data[start : start + piece])]
    assert found == packets


def test_every_truncation_of_a_packet_is_no_packet() -> None:
    data = ping()
    for size in range(len(data)):
        assert PacketStream(MOST).feed(data[:size]) == []
        with pytest.raises(MalformedPacket, match="not one IP packet"):
            read(data[:size])
    with pytest.raises(MalformedPacket, match="not one IP packet"):
        read(data + b"x")


def changed(place: int, value: bytes) -> bytes:
    data = ping()
    return data[:place] + value + data[place + len(value) :]


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (changed(0, b"\x55"), "IP version 5"),
        (changed(0, b"\x44"), "header of 16 bytes"),
        (changed(2, b"\x00\x13"), "header of 20 bytes in a packet of 19"),
        (changed(2, b"\x05\xdd"), "packet of 1501 bytes, at most 1500"),
        (changed(8, b"\x01"), "check of an IPv4 header"),
        (changed(12, b"\x0b"), "check of an IPv4 header"),
    ],
)
def test_what_is_no_packet_is_refused_with_all_behind_it(data: bytes, what: str) -> None:
    with pytest.raises(MalformedPacket, match=what):
        read(data)
    with pytest.raises(MalformedPacket, match=what):
        PacketStream(MOST).feed(ping() + data)


def test_a_header_that_is_not_whole_has_no_length_yet() -> None:
    assert packet_bytes(b"", MOST) is None
    assert packet_bytes(ping()[: HEADER.size - 1], MOST) is None
    assert packet_bytes(ping(), MOST) == 84


@pytest.mark.parametrize("size", [0, 56, 1400])
@pytest.mark.parametrize("why", list(Unreachable))
def test_scapy_reads_the_error_with_right_checks(size: int, why: Unreachable) -> None:
    lost = ping(size)
    error = IP(unreachable(read(lost), why, ROUTER))
    again = IP(bytes(error))
    del again.chksum, again.len, again[ICMP].chksum
    assert bytes(again) == bytes(error)
    assert (error.src, error.dst) == (str(ROUTER), ENDS["src"])
    assert (error[ICMP].type, error[ICMP].code) == (3, why)
    assert error[IPerror].dst == ENDS["dst"]
    assert len(error) <= 576
    assert bytes(error)[28:] == lost[:548]


@pytest.mark.parametrize(
    ("data", "answered"),
    [
        (ping(), True),
        (made(UDP() / b"x"), True),
        (made(ICMP(type=0)), True),
        *((made(ICMP(type=error) / ping()), False) for error in (3, 4, 5, 11, 12)),
        (made(UDP(), dst="224.0.0.251"), False),
        (made(UDP(), dst="255.255.255.255"), False),
        (made(UDP(), src="0.0.0.0"), False),
        (made(UDP(), src="127.0.0.1"), False),
        (made(UDP(), src="224.0.0.1"), False),
    ],
)
def test_errors_answer_only_what_rfc_1122_lets_them(data: bytes, answered: bool) -> None:
    assert read(data).may_be_answered == answered


def test_only_the_first_fragment_is_answered() -> None:
    cut = IP(ping(1400)).fragment(576)  # type: ignore[no-untyped-call]
    parts = [read(bytes(part)) for part in cut]
    assert [part.may_be_answered for part in parts] == [True, *[False] * (len(parts) - 1)]
    assert len(parts) > 2
