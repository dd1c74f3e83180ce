"""One end of the game by which wrong leaps of stepped time are counted (leaps.py), on a host.

    alice --(piece of work: a message)--> bob --(the next piece)--> charlie ...

A party with a piece of work computes, and then sends it on or waits for a timer. Time has to stand
while it computes, and from the instant at which a message or a timer is due until it is handled.
It reports each span of time that passed while it worked, by its own look at the clock.
"""

import json
import random
import select
import socket
import struct
import sys
import time
from dataclasses import dataclass, field
from typing import Any

from wire.network_time import NEVER, GateClient, SteppedTime

PORT = 7000
CONNECT_S = 60.0
MESSAGE = struct.Struct("!IQ")  # its length, and the instant at which it was sent
SIZES = (12, 100, 1_400, 2_800)  # that no window of TCP divides, as it opens with ten segments
COMPUTES_S = (0.0, 0.0, 1e-4, 1e-3, 3e-3)
LONGEST_TIMER_NS = 50_000
SENDS = 0.8  # the share of pieces of work that go on to another party


@dataclass
class Record:
    """The pieces of work of this party, and the spans in which time had to stand."""

    pieces: int = 0
    spans: list[tuple[int, int]] = field(default_factory=list)

    def stood(self, since_ns: int, now_ns: int) -> None:
        """Note that time had to stand from one instant to another."""
        if now_ns != since_ns:
            self.spans.append((since_ns, now_ns))


class Party:
    """A host's end of the game, with a connection to each other party."""

    def __init__(self, words: dict[str, Any]) -> None:
        self.clock = SteppedTime(1.0, words["since_ns"], words["folder"])
        self.record = Record()
        self._random = random.Random(f"{words['seed']} {words['name']}")
        self._delays_ns: dict[str, int] = words["delays_ns"]
        self._gate = GateClient(self.clock)
        self._due: list[int] = []
        self._others = connected(words["name"], words["addresses"])
        self._unread = dict.fromkeys(self._others, b"")
        self._poll = select.poll()
        for file in (sys.stdin, self._gate, *self._others.values()):
            self._poll.register(file, select.POLLIN)

    def play(self) -> None:
        """Work until standard input ends; its first line gives this party a piece of work."""
        names = {other.fileno(): name for name, other in self._others.items()}
        while True:
            self._gate.wait_for(min(self._due, default=NEVER))
            ready = {file for file, _event in self._poll.poll()}
            began_ns = self.clock.now_ns()
            if sys.stdin.fileno() in ready:
                if not sys.stdin.readline():
                    return
                self._work()
            if self._gate.fileno() in ready:
                self._gate.take_notice()
                self._serve_timers(began_ns)
            for file in ready & names.keys():
                self._serve(names[file], began_ns)
            self.record.stood(began_ns, self.clock.now_ns())

    def _serve_timers(self, now_ns: int) -> None:
        for due_ns in [each for each in self._due if each <= now_ns]:
            self._due.remove(due_ns)
            self.record.stood(due_ns, now_ns)
            self._work()

    def _serve(self, name: str, now_ns: int) -> None:
        unread = self._unread[name] + self._others[name].recv(1 << 16)
        while len(unread) >= MESSAGE.size:
            length, sent_ns = MESSAGE.unpack_from(unread)
            if len(unread) < length:
                break
            unread = unread[length:]
            self.record.stood(sent_ns + self._delays_ns[name], now_ns)
            self._work()
        self._unread[name] = unread

    def _work(self) -> None:
        """Compute for a while; then send, or have a timer."""
        self.record.pieces += 1
        until_s = time.perf_counter() + self._random.choice(COMPUTES_S) * self._random.random()
        while time.perf_counter() < until_s:
            pass
        now_ns = self.clock.now_ns()
        if self._random.random() < SENDS:
            length = self._random.choice(SIZES)
            other = self._others[self._random.choice(sorted(self._others))]
            other.sendall(MESSAGE.pack(length, now_ns) + bytes(length - MESSAGE.size))
        else:
            self._due.append(now_ns + self._random.randrange(1, LONGEST_TIMER_NS))


def connected(name: str, addresses: dict[str, str]) -> dict[str, socket.socket]:
    """Connect to all parties; raise OSError if one is not there."""
    found: dict[str, socket.socket] = {}
    with socket.create_server((addresses[name], PORT)) as listener:
        print(json.dumps("listens"), flush=True)
        sys.stdin.readline()
        for other in sorted(addresses):
            if other > name:
                found[other] = socket.create_connection((addresses[other], PORT), CONNECT_S)
                found[other].sendall(name.encode() + b"\n")
        while len(found) < len(addresses) - 1:
            connection = listener.accept()[0]
            found[connection.makefile("r").readline().strip()] = connection
    for connection in found.values():
        connection.settimeout(None)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return found


def main() -> None:
    """Play to the end, and tell what was seen."""
    party = Party(json.loads(sys.argv[1]))
    print(json.dumps("ready"), flush=True)
    party.play()
    print(json.dumps({"pieces": party.record.pieces, "spans": party.record.spans}), flush=True)


if __name__ == "__main__":
    main()
