"""IPv6 packets in a stream, and ICMPv6 errors: RFC 8200, 4443; scapy as independent decoder."""

from ipaddress import IPv6Address
from typing import Any

import pytest
from scapy.layers.inet import ICMP, IP, UDP
from scapy.layers.inet6 import (
    ICMPv6DestUnreach,
    ICMPv6EchoRequest,
    ICMPv6PacketTooBig,
    ICMPv6TimeExceeded,
    IPerror6,
    IPv6,
    IPv6ExtHdrDestOpt,
    IPv6ExtHdrFragment,
    IPv6ExtHdrHopByHop,
)
from scapy.packet import Packet as ScapyPacket

from applications.ip_over_light.ip_packet import PacketStream, decode, packet_bytes, unreachable
from applications.ip_over_light.ipv6 import HEADER
from applications.ip_over_light.lost_packet import Packet, Unreachable
from wire.malformed import MalformedPacket

MOST = 1500
ROUTER = IPv6Address("fd71:6d6e::ffff")
ENDS = {"src": "fd71:6d6e::1", "dst": "fd71:6d6e::2"}
# RFC 4443, 3.1
CODES = {
    Unreachable.NETWORK: 0,
    Unreachable.PROHIBITED: 1,
    Unreachable.HOST: 3,
    Unreachable.HOST_UNKNOWN: 3,
    Unreachable.PORT: 4,
}


def made(payload: ScapyPacket, **header: Any) -> bytes:
    return bytes(IPv6(**{**ENDS, **header}) / payload)


def ping(size: int = 56) -> bytes:
    return made(ICMPv6EchoRequest(data=bytes(size)))


def read(data: bytes) -> Packet:
    return decode(data, MOST)


def test_a_packet_is_read_as_scapy_wrote_it() -> None:
    data = made(UDP(dport=53) / b"question", tc=4, hlim=9)
    packet = read(data)
    assert (packet.data, str(packet.source), str(packet.destination)) == (data, *ENDS.values())
    assert (packet.protocol, packet.first, packet.header_bytes) == (17, True, 40)


def test_what_is_carried_is_found_behind_extension_headers() -> None:
    options = IPv6ExtHdrHopByHop() / IPv6ExtHdrDestOpt()
    packet = read(made(options / ICMPv6EchoRequest(data=b"x")))
    assert (packet.protocol, packet.first, packet.header_bytes) == (58, True, 56)
    for offset, first in ((0, True), (8, False)):
        data = made(IPv6ExtHdrFragment(offset=offset, m=1) / ICMPv6EchoRequest(data=bytes(8)))
        assert (read(data).protocol, read(data).first) == (58, first)


@pytest.mark.parametrize("piece", [1, 7, 20, 40, 83, 1000])
def test_packets_of_both_versions_come_out_of_a_stream_however_it_is_cut(piece: int) -> None:
    fourth = bytes(IP(src="10.1.0.1", dst="10.1.0.2") / ICMP() / b"x")
    packets = [ping(), fourth, ping(0), ping(1400), fourth]
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
    assert packet_bytes(data[: HEADER.size - 1], MOST) is None


def test_a_packet_that_is_too_long_is_refused() -> None:
    with pytest.raises(MalformedPacket, match="IPv6 packet of 1501 bytes, at most 1500"):
        read(ping(1453))


@pytest.mark.parametrize("size", [0, 56, 1400])
@pytest.mark.parametrize("why", list(Unreachable))
def test_scapy_reads_the_error_with_the_right_check(size: int, why: Unreachable) -> None:
    lost = ping(size)
    error = IPv6(unreachable(read(lost), why, ROUTER))
    again = IPv6(bytes(error))
    del again.plen, again[ICMPv6DestUnreach].cksum
    assert bytes(again) == bytes(error)
    assert (error.src, error.dst) == (str(ROUTER), ENDS["src"])
    assert (error[ICMPv6DestUnreach].type, error[ICMPv6DestUnreach].code) == (1, CODES[why])
    assert error[IPerror6].dst == ENDS["dst"]
    assert len(error) <= 1280
    assert bytes(error)[48:] == lost[: 1280 - 48]


@pytest.mark.parametrize(
    ("data", "answered"),
    [
        (ping(), True),
        (made(UDP() / b"x"), True),
        *(
            (made(error() / IPerror6(ping())), False)
            for error in (ICMPv6DestUnreach, ICMPv6PacketTooBig, ICMPv6TimeExceeded)
        ),
        (made(UDP(), dst="ff02::16"), False),
        (made(UDP(), src="::"), False),
        (made(UDP(), src="::1"), False),
        (made(IPv6ExtHdrFragment(offset=8) / UDP()), False),
    ],
)
def test_errors_answer_only_what_rfc_4443_lets_them(data: bytes, answered: bool) -> None:
    assert read(data).may_be_answered == answered
