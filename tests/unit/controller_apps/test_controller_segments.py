"""Frames with TCP over IPv4: reading them, and replacing a payload."""

import random

import pytest
from metadata_scene import ALICE, BOB, frame, payload_of
from scapy.layers.inet import IP, TCP, UDP
from scapy.layers.l2 import Ether
from scapy.packet import Packet

from controller_apps.packets import (
    ETHERNET_LENGTH,
    FiveTuple,
    checksum,
    is_without_data,
    parse_segment,
)
from wire.malformed import MalformedPacket
from wire.metadata.header import METADATA_PORT


def test_a_segment_is_read_as_scapy_wrote_it() -> None:
    segment = parse_segment(frame(b"hello", sport=4242, seq=0xFFFFFFF0, flags="PA"))
    assert segment.five_tuple == FiveTuple(ALICE, 4242, BOB, METADATA_PORT)
    assert (segment.sequence, segment.payload, segment.closes) == (0xFFFFFFF0, b"hello", False)


def test_a_frame_is_read_once_for_journal_and_arbiter() -> None:
    read = frame(b"hello", flags="PA")
    assert not is_without_data(read)
    assert parse_segment(read) is parse_segment(read)


def test_ethernet_padding_is_no_payload() -> None:
    assert parse_segment(frame() + b"\0" * 6).payload == b""


@pytest.mark.parametrize("flags", ["FA", "R", "RA", "FPA"])
def test_fin_and_rst_close(flags: str) -> None:
    assert parse_segment(frame(flags=flags)).closes


@pytest.mark.parametrize(
    ("read", "empty"),
    [
        (frame(flags="A"), True),
        (frame(flags="A") + b"\0" * 6, True),
        (frame(b"x", flags="A"), False),
        (frame(flags="SA"), True),
        (frame(b"x", flags="FA"), False),
        (frame(flags="A")[:40], False),
        (bytes(60), False),
    ],
)
def test_a_segment_without_data_is_told_from_others(read: bytes, empty: bool) -> None:
    assert is_without_data(read) is empty


@pytest.mark.parametrize("length", [0, 1, 76, 77, 1000])
def test_a_replaced_payload_has_right_lengths_and_checksums(length: int) -> None:
    options = [("Timestamp", (123, 456)), ("NOP", None), ("NOP", None)]
    original = frame(b"before, and some more", flags="PAEC", options=options)
    payload = random.Random(length).randbytes(length)
    rewritten = parse_segment(original).with_payload(payload)
    assert payload_of(rewritten) == payload
    before, after = Ether(original), Ether(rewritten)
    for field in ("seq", "ack", "flags", "window", "options"):
        assert getattr(after[TCP], field) == getattr(before[TCP], field)


def test_ip_options_stay() -> None:
    packet = Ether() / IP(src=ALICE, dst=BOB, options=b"\x94\x04\0\0") / TCP(flags="PA") / b"one"
    rewritten = parse_segment(bytes(packet)).with_payload(b"two")
    assert payload_of(rewritten) == b"two"
    assert Ether(rewritten)[IP].ihl == 6


def test_an_unfinished_checksum_is_finished() -> None:
    data = bytearray(frame(b"payload"))
    data[ETHERNET_LENGTH + 20 + 16] ^= 0xFF
    assert payload_of(parse_segment(bytes(data)).with_payload(b"payload")) == b"payload"


def test_checksum_agrees_with_rfc_1071() -> None:
    assert checksum(bytes.fromhex("0001f203f4f5f6f7")) == 0xFFFF - 0xDDF2


def test_what_is_not_tcp_over_ipv4_is_malformed() -> None:
    ethernet, ip = Ether(), IP(src=ALICE, dst=BOB)
    tcp = TCP(dport=METADATA_PORT)
    packets: dict[str, Packet] = {
        "UDP": ethernet / ip / UDP(),
        "ARP": Ether(type=0x0806) / (b"\0" * 40),
        "first fragment": ethernet / IP(src=ALICE, dst=BOB, flags="MF") / tcp,
        "later fragment": ethernet / IP(src=ALICE, dst=BOB, frag=1) / tcp,
        "IP version": ethernet / IP(version=5, ihl=5, src=ALICE, dst=BOB) / tcp,
        "IP header length": ethernet / IP(ihl=4, src=ALICE, dst=BOB) / tcp,
        "TCP header length": ethernet / ip / TCP(dataofs=4),
        "TCP header beyond the end": ethernet / ip / TCP(dataofs=15),
    }
    for name, packet in packets.items():
        with pytest.raises(MalformedPacket):
            pytest.fail(f"{name}: {parse_segment(bytes(packet))}")


@pytest.mark.nightly
def test_random_bytes_are_malformed_or_what_scapy_reads() -> None:
    draw, read = random.Random(1), 0
    whole = bytearray(frame(b"payload"))
    for _ in range(5000):
        data = bytearray(whole)
        for _ in range(draw.choice((1, 1, 3))):
            data[draw.randrange(len(data))] = draw.randrange(256)
        try:
            segment = parse_segment(bytes(data))
        except MalformedPacket:
            continue
        read += 1
        packet = Ether(bytes(data))
        ip, tcp = packet[IP], packet[TCP]
        assert (ip.version, ip.frag, ip.flags.MF) == (4, 0, False)
        assert segment.five_tuple == FiveTuple(ip.src, tcp.sport, ip.dst, tcp.dport)
        assert (segment.sequence, segment.flags) == (tcp.seq, int(tcp.flags) & 0xFF)
        assert segment.payload == data[14 + 4 * (ip.ihl + tcp.dataofs) : 14 + ip.len]
    assert 1000 < read < 4900


def test_a_tcp_option_of_length_zero_does_no_harm() -> None:
    packet = bytearray(frame(b"payload", options=[("Timestamp", (1, 2))]))
    packet[ETHERNET_LENGTH + 40 : ETHERNET_LENGTH + 42] = b"\x63\0"
    assert parse_segment(bytes(packet)).payload == b"payload"
