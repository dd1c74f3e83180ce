"""Cables of some length: what goes in at one end comes out at the other after the delay.

    alice-eth0 --(TAP)--> Forwarder, a queue for each direction --(TAP)--> s1-eth1

Both ends are TAP interfaces, whose other sides are files that this process holds. The delay begins
when a packet is read, which is after it was sent, so that none is early. A cable with a rate is a
first-in, first-out queue: a packet takes as long as its bits, and packets that find the queue full
are lost. The software at an end may take a time for each message: it gets the bytes so much later,
in their order, while what has no bytes passes at once; queued, one after the other, whichever cable
they come by. Packets to and from the dispatcher's address
belong to the simulation: no cable delays them. In stepped time what programs send in the background
takes none, unless packets are before it. The clock makes no leap for acknowledgements that nobody
seems to wait for, but stops at their instants on its way: a sender may wait after all (RFC 896),
and else time out.
"""

import heapq
import os
import random
import select
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from ipaddress import IPv4Address
from itertools import count

from copper.acknowledgements import IPV4, Acknowledgements, message_bytes
from programs.timeouts import STALL_S
from wire.config import CopperConfig
from wire.network_time import CABLES, NEVER, WATCH, GateClient, SteppedTime
from wire.parameters.delays import draws, is_queued

MOST_BYTES = 1 << 16
AT_ONCE = 64  # frames read from one end before the next is served
CLOSED_AT_ONCE = 64  # ends
QUEUE_BYTES = 1 << 20  # of each direction of a slow cable
ENDS = slice(26, 38)  # addresses and ports of a frame with IPv4
ARP = b"\x08\x06"
# Where sender and target are, behind the Ethernet header.
ADDRESSES = {IPV4: (slice(26, 30), slice(30, 34)), ARP: (slice(28, 32), slice(38, 42))}


class Software:
    """The software at the end of a cable: when it has handled the messages that have arrived.

    Draws follow from the instant: no other message takes their place.
    """

    def __init__(self, text: str, seed: str, since_ns: int = 0) -> None:
        self._seed, self._since_ns, self._random = seed, since_ns, random.Random()  # noqa: S311
        self._draw = draws(text, self._random)
        self._is_queued = is_queued(text)
        self._handled_ns = 0  # when it has handled the last one

    def handled_ns(self, arrived_ns: int) -> int:
        """Return when it has handled the next message."""
        self._random.seed(f"{self._seed} {arrived_ns - self._since_ns}")
        begin_ns = max(self._handled_ns, arrived_ns) if self._is_queued else arrived_ns
        self._handled_ns = max(self._handled_ns + 1, begin_ns + self._draw())
        return self._handled_ns


@dataclass
class Direction:
    """A cable from one end to the other."""

    into: int  # files of both ends
    out_of: int
    delay_ns: int
    loss: float
    ns_per_byte: float = 0.0
    free_ns: int = 0  # when the queue is empty
    last_due_ns: int = 0  # when the last frame comes out
    software: Software | None = None  # at its end; None: it takes no time

    def due_ns(self, length: int, now_ns: int) -> int | None:
        """Return when a frame that enters now comes out; None if the queue is full."""
        if self.free_ns - now_ns > QUEUE_BYTES * self.ns_per_byte:
            return None
        self.free_ns = max(self.free_ns, now_ns) + round(length * self.ns_per_byte)
        return self.free_ns + self.delay_ns


class Forwarder:
    def __init__(self, config: CopperConfig) -> None:
        """Take over the files of the ends; raise OSError if one is not there."""
        self._directions: dict[int, Direction] = {}
        self._dispatcher = IPv4Address(config.simulation).packed
        self._wake_reader, self._wake_writer = os.pipe()
        self._readable = select.epoll()
        self._readable.register(self._wake_reader, select.EPOLLIN)
        queued: dict[str, Software] = {}
        for cable in config.cables:
            delay_ns = round(config.time.wall_s(cable.delay_s) * 1e9)
            ns_per_byte = config.time.wall_s(8e-6 / cable.mbps) * 1e9 if cable.mbps else 0.0
            ways = (
                (cable.a_fd, cable.b_fd, cable.b, cable.b_software),
                (cable.b_fd, cable.a_fd, cable.a, cable.a_software),
            )
            for into, out_of, name, software in ways:
                os.set_blocking(into, False)
                way = Direction(into, out_of, delay_ns, cable.loss, ns_per_byte)
                if software:
                    program = Software(software, f"{config.seed} {name}", config.time.since_ns)
                    one = is_queued(software)
                    way.software = queued.setdefault(name, program) if one else program
                self._directions[into] = way
                self._readable.register(into, select.EPOLLIN)
        time_ = self._time = config.time
        self._gate = self._on_the_way = None
        if isinstance(time_, SteppedTime):
            self._gate, self._on_the_way = GateClient(time_, CABLES), GateClient(time_, WATCH)
        self._now_ns = time_.now_ns if self._gate else time.monotonic_ns
        self._acknowledgements = Acknowledgements()
        self._unawaited: list[tuple[int, Direction, bytes]] = []  # when due, on which way, frame
        gates = self._gate, self._on_the_way
        self._gates = {each.fileno(): each for each in gates if each}
        for gate in self._gates.values():
            self._readable.register(gate, select.EPOLLIN)
        self._draws = random.Random(config.seed)  # noqa: S311
        # When due, who speaks to whom, number, on which way, by which software first, frame.
        self._under_way: list[tuple[int, bytes, int, Direction, Software | None, bytes]] = []
        self._numbers = count()
        self.held = self.lost = 0

    def stop(self) -> None:
        """Let `run` return; a signal handler may call it."""
        os.write(self._wake_writer, b"\0")

    def run(self) -> None:
        """Forward until stopped; packets that are then under way are lost."""
        while True:
            # epoll waits for milliseconds, select for microseconds, but not for many files.
            if not select.select([self._readable], [], [], self._wait_s())[0]:
                self._await_acknowledgements()
            for file, _events in self._readable.poll(0):
                if file == self._wake_reader:
                    return
                if file in self._gates:
                    self._gates[file].take_notice()
                    continue
                if not self._take_in(self._directions[file]):
                    self._readable.unregister(file)
            self._give_out()

    def close(self) -> None:
        """Close all ends at once: the kernel waits some 15 ms for each."""
        self._readable.close()
        for gate in self._gates.values():
            gate.close()
        with ThreadPoolExecutor(CLOSED_AT_ONCE) as pool:
            list(pool.map(os.close, self._directions))

    def _wait_s(self) -> float | None:
        if self._gate and self._on_the_way:
            self._gate.wait_for(self._under_way[0][0] if self._under_way else NEVER)
            self._on_the_way.wait_for(min((each[0] for each in self._unawaited), default=NEVER))
            return STALL_S if self._unawaited else None
        if not self._under_way:
            return None
        return max(0, self._under_way[0][0] - time.monotonic_ns()) / 1e9

    def _take_in(self, direction: Direction) -> bool:
        """Read the frames that wait; return whether the end is still open."""
        for _ in range(AT_ONCE):
            try:
                frame = os.read(direction.into, MOST_BYTES)
            except BlockingIOError:
                return True
            except OSError:  # the interface has been removed
                return False
            if not frame:
                return False
            if self._is_simulation(frame) or self._takes_no_time(direction):
                self._write(direction.out_of, frame)
            else:
                self._hold(direction, frame)
        return True

    def _hold(self, direction: Direction, frame: bytes) -> None:
        lost = direction.loss and self._draws.random() < direction.loss
        due_ns = None if lost else direction.due_ns(len(frame), self._now_ns())
        if due_ns is None:
            self.lost += 1
            return
        self.held += 1
        if self._gate and self._acknowledgements.is_unawaited(
            direction.into, direction.out_of, frame
        ):
            self._unawaited.append((due_ns, direction, frame))
            return
        software = direction.software if message_bytes(frame) else None
        self._put(due_ns, direction, software, frame)

    def _await_acknowledgements(self) -> None:
        """Let the clock leap to them, too: a sender may wait for one (Nagle, RFC 896)."""
        for due_ns, way, frame in self._unawaited:
            self._put(due_ns, way, None, frame)
        self._unawaited.clear()

    def _put(self, due_ns: int, way: Direction, software: Software | None, frame: bytes) -> None:
        way.last_due_ns = max(way.last_due_ns, due_ns)
        ends = frame[ENDS] if self._gate else b""  # of one instant, the machine orders them
        heapq.heappush(self._under_way, (due_ns, ends, next(self._numbers), way, software, frame))

    def _give_out(self) -> None:
        now_ns = self._now_ns()
        for held in [each for each in self._unawaited if each[0] <= now_ns]:
            self._unawaited.remove(held)
            self._write(held[1].out_of, held[2])
        while self._under_way and self._under_way[0][0] <= now_ns:
            due_ns, _ends, _number, way, software, frame = heapq.heappop(self._under_way)
            if software is None:
                self._write(way.out_of, frame)
            else:
                self._put(software.handled_ns(due_ns), way, None, frame)

    def _takes_no_time(self, direction: Direction) -> bool:
        """Whether what programs send now is of the background, and behind no other packet."""
        if not isinstance(self._time, SteppedTime) or not self._time.in_background:
            return False
        return direction.last_due_ns <= self._time.now_ns()

    def _is_simulation(self, frame: bytes) -> bool:
        addresses = ADDRESSES.get(frame[12:14], ())
        return any(frame[place] == self._dispatcher for place in addresses)

    def _write(self, file: int, frame: bytes) -> None:
        try:
            os.write(file, frame)
        except OSError:  # the far end is down, or it is not a frame
            self.lost += 1
