"""Segments of TCP on cables, and acknowledgements for which nobody waits.

The sender of a few segments may send more without them: the clock need not leap to their arrival.
"""

import socket
from collections import deque

IPV4 = b"\x08\x00"
IP, PROTOCOL = 14, 23  # in a frame
HEADER = 20  # octets of TCP, at least
ACKNOWLEDGES = 0x10  # of the flags, alone
FEW = 4  # segments; a connection that loses nothing has at least 10 under way
NUMBERS, HALF = 1 << 32, 1 << 31  # of octets, modulo


def is_segment(frame: bytes) -> bool:
    is_tcp = frame[12:14] == IPV4 and frame[PROTOCOL] == socket.IPPROTO_TCP
    return is_tcp and len(frame) >= IP + 4 * (frame[IP] & 0xF) + HEADER


def message_bytes(frame: bytes) -> int:
    """Return how many bytes a frame carries; what carries none, the kernel handles."""
    if not is_segment(frame):
        return 0
    tcp = IP + 4 * (frame[IP] & 0xF)
    return max(0, IP + int.from_bytes(frame[IP + 2 : IP + 4]) - tcp - 4 * (frame[tcp + 12] >> 4))


class Acknowledgements:
    """Segments that have entered cables, until they are acknowledged."""

    def __init__(self) -> None:
        # By the end of a cable, and addresses and ports: the numbers behind the last octets.
        self._sent: dict[tuple[int, bytes], deque[int]] = {}

    def is_unawaited(self, into: int, out_of: int, frame: bytes) -> bool:
        """Note a frame on its way between two ends; return whether nobody waits for it."""
        if not is_segment(frame):
            return False
        tcp, length = IP + 4 * (frame[IP] & 0xF), message_bytes(frame)
        number, acknowledged = (int.from_bytes(frame[tcp + at : tcp + at + 4]) for at in (4, 8))
        addresses, ports = frame[26:34], frame[tcp : tcp + 4]
        if length:
            sent = self._sent.setdefault((into, addresses + ports), deque())
            sent.append((number + length) % NUMBERS)
        back = out_of, addresses[4:] + addresses[:4] + ports[2:] + ports[:2]
        sent = self._sent.get(back, deque())
        under_way = len(sent)
        while sent and (acknowledged - sent[0]) % NUMBERS < HALF:
            sent.popleft()
        if not sent:
            self._sent.pop(back, None)
        alone = not length and frame[tcp + 13] == ACKNOWLEDGES
        return alone and len(sent) < under_way <= FEW
