"""The frames that the program of an attacker takes for pings, by Scapy."""

from ipaddress import IPv4Address

import pytest
from scapy.layers.inet import ICMP, IP, TCP, UDP
from scapy.layers.l2 import ARP, Ether
from scapy.packet import Packet

from evidence.attacks.frames import ADDRESSES, is_ping

MAC, OTHER_MAC = "00:00:00:00:00:03", "00:00:00:00:00:01"
BOB, ALICE = "10.0.0.2", "10.0.0.1"


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        (Ether(dst=MAC) / IP(src=BOB, dst=ALICE) / ICMP(type="echo-request"), True),
        (Ether(dst=MAC) / IP(src=BOB, dst=ALICE) / ICMP(type="echo-request") / bytes(56), True),
        (Ether(dst=MAC) / IP(src=BOB, dst=ALICE) / ICMP(type="echo-reply"), False),
        (Ether(dst=MAC) / IP(src=ALICE, dst=BOB) / ICMP(type="echo-request"), False),
        (Ether(dst=OTHER_MAC) / IP(src=BOB, dst=ALICE) / ICMP(type="echo-request"), False),
        (Ether(dst=MAC) / IP(src=BOB, dst=ALICE) / UDP(sport=0x0800, dport=9), False),
        (Ether(dst=MAC) / IP(src=BOB, dst=ALICE) / TCP(sport=0x0800), False),
        (Ether(dst=MAC) / ARP(psrc=BOB, pdst=ALICE), False),
        (Ether(dst=MAC, type=0x0800), False),
    ],
)
def test_a_ping_is_an_echo_request_for_the_attacker(frame: Packet, expected: bool) -> None:
    wanted = ADDRESSES.pack(IPv4Address(BOB).packed, IPv4Address(ALICE).packed)
    assert is_ping(bytes(frame), bytes.fromhex(MAC.replace(":", "")), wanted) == expected
