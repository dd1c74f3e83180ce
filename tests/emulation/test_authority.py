"""Hosts that act beyond their rights in a whole network, and what comes of it."""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from scapy.layers.inet import TCP
from scapy.packet import Packet
from scapy.utils import rdpcap
from test_service_faults import BOB, CHARLIE, facts, listening, require_nothing_left

from topologies.network import Network
from wire.metadata import (
    METADATA_PORT,
    Answer,
    Message,
    Reason,
    Service,
    Setup,
    Verdict,
    decode,
    message_length,
)

SETUP = Setup(0xF06ED, Service.TELEPORT, 1, CHARLIE, 100, 1, 1_000_000, port=9)
# More than a segment takes: PSH is set only in the last one, and the set-up is in the first.
BEHIND = bytes(6000)
SPEAK = """
import socket, sys
with socket.create_connection((sys.argv[1], int(sys.argv[2])), 5) as connection:
    connection.settimeout(3)
    connection.sendall(open(sys.argv[3], "rb").read())
    try:
        print("heard=" + connection.recv(65536).hex())
    except TimeoutError:
        print("heard=")
"""


def spoken(network: Network, host: str, data: bytes, to: str = BOB) -> Message | None:
    """Let a host say something to a stack in one write; return what it hears, None for silence."""
    script, said = network.runtime.logs / "speak.py", network.runtime.logs / "said"
    script.write_text(SPEAK)
    said.write_bytes(data)
    told = network.host(host).cmd(f"{sys.executable} {script} {to} {METADATA_PORT} {said}")
    (heard,) = re.findall(r"heard=([0-9a-f]*)", told)
    answer = bytes.fromhex(heard)
    return decode(answer[: message_length(answer)]) if answer else None


def first_with_payload(capture: Path) -> Packet:
    """Return the first segment to the metadata port that has data."""
    packets = (packet for packet in rdpcap(str(capture)) if TCP in packet)
    segments: Iterator[Packet] = (packet[TCP] for packet in packets)
    return next(each for each in segments if each.dport == METADATA_PORT and bytes(each.payload))


def test_a_segment_without_psh_is_arbitrated_like_any_other(network: Network) -> None:
    capture = next(path for path in network.capture("s1") if path.name == "s1-eth1.pcap")
    granted = replace(SETUP, verdict=Verdict.GRANTED)
    with listening(network, "teleport"):
        assert spoken(network, "alice", granted.encode() + BEHIND) is None
        asked = spoken(network, "alice", replace(SETUP, session=1).encode() + BEHIND)
        assert isinstance(asked, Answer)
        assert asked.reason == Reason.OK  # what follows is not a message, and ends it
        require_nothing_left(network)
        assert [fact["session"] for fact in facts(network, "granted")] == [f"{1:016x}"]
    assert first_with_payload(capture).flags == "A"
