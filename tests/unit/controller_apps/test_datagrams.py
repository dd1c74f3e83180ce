"""Datagrams in frames, with scapy as the independent reader and writer."""

import random

import pytest
from scapy.layers.inet import IP, UDP
from scapy.layers.l2 import Ether

from controller_apps.packets import Frame, is_management, is_udp
from wire.malformed import MalformedPacket

FRAME = Frame(
    bytes.fromhex("020000000001"),
    bytes.fromhex("020000000002"),
    "10.0.0.254",
    "10.0.0.1",
    9012,
    9013,
    b"what it carries",
)


def test_scapy_reads_what_is_written() -> None:
    data = FRAME.encode()
    packet, again = Ether(data), Ether(data)
    assert (packet.src, packet.dst) == ("02:00:00:00:00:01", "02:00:00:00:00:02")
    assert (packet[IP].src, packet[IP].dst, packet[IP].proto) == ("10.0.0.254", "10.0.0.1", 17)
    assert (packet[UDP].sport, packet[UDP].dport) == (9012, 9013)
    assert bytes(packet[UDP].payload) == FRAME.payload
    del again[IP].len, again[IP].chksum, again[UDP].len, again[UDP].chksum
    assert bytes(again) == data


def test_what_scapy_writes_is_read_with_options_and_padding() -> None:
    packet = (
        Ether(src="02:00:00:00:00:01", dst="02:00:00:00:00:02")
        / IP(src=FRAME.source, dst=FRAME.destination, options=[b"\1\1\1\1"])
        / UDP(sport=9012, dport=9013)
        / FRAME.payload
    )
    assert Frame.decode(bytes(packet) + bytes(9)) == FRAME


def test_a_fragment_is_malformed() -> None:
    fragment = bytearray(FRAME.encode())
    fragment[20] = 0x20  # more fragments
    with pytest.raises(MalformedPacket, match="do not fit"):
        Frame.decode(bytes(fragment))


def test_random_bytes_are_malformed_or_what_scapy_reads() -> None:
    generator, read = random.Random(3), 0
    for _ in range(2000):
        data = bytearray(FRAME.encode())
        for _ in range(generator.choice((1, 1, 3))):
            data[generator.randrange(len(data))] = generator.randrange(256)
        try:
            frame = Frame.decode(bytes(data))
        except MalformedPacket:
            continue
        read += 1
        packet = Ether(bytes(data))
        assert (frame.source, frame.destination) == (packet[IP].src, packet[IP].dst)
        assert (packet[IP].version, packet[IP].frag, packet[IP].flags.MF) == (4, 0, False)
        assert (frame.source_port, frame.destination_port) == (packet[UDP].sport, packet[UDP].dport)
        assert frame.destination_mac + frame.source_mac == data[:12]
        assert frame.payload == data[14 + 4 * packet[IP].ihl + 8 : 14 + packet[IP].len]
    assert 500 < read < 1900


def test_other_traffic_is_not_taken_for_datagrams() -> None:
    assert is_udp(FRAME.encode())
    assert not is_udp(bytes(Ether(type=0x9999) / bytes(60)))
    assert not is_udp(bytes(Ether() / IP(proto=6) / bytes(20)))
    assert not is_udp(b"")


@pytest.mark.parametrize(
    ("frame", "manages"),
    [
        (Ether(type=0x88CC) / b"\2\7\4", True),  # LLDP
        (Ether() / IP() / UDP(dport=9012), True),
        (Ether() / IP() / UDP(sport=9012), False),
        (Ether(type=0x88B5) / b"QMNA", False),
        (Ether() / IP(proto=6) / (b"\0" * 20), False),
    ],
)
def test_management_is_lldp_and_what_agents_send(frame: Ether, manages: bool) -> None:
    assert is_management(bytes(frame)) is manages
