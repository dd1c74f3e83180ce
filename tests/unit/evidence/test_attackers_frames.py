"""The frames that the program of an attacker takes for pings, by Scapy."""

import pytest
from scapy.layers.inet import ICMP, IP, TCP, UDP
from scapy.layers.l2 import ARP, Ether
from scapy.packet import Packet

from evidence.attacks.frames import is_ping

MAC, OTHER_MAC = "00:00:00:00:00:03", "00:00:00:00:00:01"
OWN = bytes.fromhex(MAC.replace(":", ""))
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
    assert is_ping(bytes(frame), OWN, victim=BOB, posed=ALICE) == expected


def test_a_frame_that_is_cut_is_a_ping_if_the_type_is_in_it() -> None:
    frame = bytes(Ether(dst=MAC) / IP(src=BOB, dst=ALICE) / ICMP(type="echo-request"))
    for size in range(len(frame)):
        assert is_ping(frame[:size], OWN, victim=BOB, posed=ALICE) == (size > 14 + 20)
