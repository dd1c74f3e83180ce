"""Cables of some length: what goes in at one end comes out at the other after the delay.

    alice-eth0 --(TAP)--> Forwarder, a queue for each direction --(TAP)--> s1-eth1

Both ends are TAP interfaces, whose other sides are files that this process holds. A packet is due
by when it was read, which is after it was sent, so that none is ever early. Where a cable has a
rate, packets go one behind the other, first come first served: each is under way for as long as
its bits take, and those that find the queue full are lost. What the simulation itself says, to and
from the dispatcher's address, is held back by no cable.
"""

import os
import random
import select
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from ipaddress import IPv4Address

from wire.config import CopperConfig

MOST_BYTES = 1 << 16
AT_ONCE = 64  # frames read from one end before others have their turn
CLOSED_AT_ONCE = 64  # ends
QUEUE_BYTES = 1 << 20  # that may wait for a slow cable, in each direction
IPV4, ARP = b"\x08\x00", b"\x08\x06"
# Where sender and target are, behind the Ethernet header.
ADDRESSES = {IPV4: (slice(26, 30), slice(30, 34)), ARP: (slice(28, 32), slice(38, 42))}


@dataclass
class Direction:
    """One end of a cable, where packets go in, and what is on its way to the other end."""

    into: int  # files of both ends
    out_of: int
    delay_ns: int
    loss: float
    ns_per_byte: float = 0.0
    free_ns: float = 0.0  # when all that came so far has been sent
    under_way: deque[tuple[int, bytes]] = field(default_factory=deque)  # when due, what

    def take(self, frame: bytes, now_ns: int) -> bool:
        """Put a frame behind the others; return whether there was room."""
        if self.free_ns - now_ns > QUEUE_BYTES * self.ns_per_byte:
            return False
        self.free_ns = max(self.free_ns, now_ns) + len(frame) * self.ns_per_byte
        self.under_way.append((round(self.free_ns) + self.delay_ns, frame))
        return True


class Forwarder:
    """Moves packets between the ends of cables."""

    def __init__(self, config: CopperConfig) -> None:
        """Take over the files of the ends; raise OSError if one is not there."""
        self._directions: dict[int, Direction] = {}
        self._at_once = IPv4Address(config.simulation).packed
        for cable in config.cables:
            delay_ns = round(config.time.wall_s(cable.delay_s) * 1e9)
            ns_per_byte = config.time.wall_s(8e-6 / cable.mbps) * 1e9 if cable.mbps else 0.0
            for into, out_of in ((cable.a_fd, cable.b_fd), (cable.b_fd, cable.a_fd)):
                os.set_blocking(into, False)
                way = Direction(into, out_of, delay_ns, cable.loss, ns_per_byte)
                self._directions[into] = way
        self._open = list(self._directions)  # where more may come in
        self._draws = random.Random(config.seed)  # noqa: S311
        self._wake_reader, self._wake_writer = os.pipe()
        self.held = self.lost = 0

    def stop(self) -> None:
        """Let `run` return; a signal handler may call it."""
        os.write(self._wake_writer, b"\0")

    def run(self) -> None:
        """Forward until told to stop; what is still on its way then is lost."""
        while True:
            files = [*self._open, self._wake_reader]
            # Unlike poll and epoll, select waits for microseconds.
            readable, _, _ = select.select(files, [], [], self._wait_s())
            if self._wake_reader in readable:
                return
            for file in readable:
                if not self._take_in(self._directions[file]):
                    self._open.remove(file)
            self._give_out()

    def close(self) -> None:
        """Take away all ends, beside each other: the kernel waits some 15 ms with each of them."""
        with ThreadPoolExecutor(CLOSED_AT_ONCE) as pool:
            list(pool.map(os.close, self._directions))

    def _wait_s(self) -> float | None:
        due = [each.under_way[0][0] for each in self._directions.values() if each.under_way]
        return max(0, min(due) - time.monotonic_ns()) / 1e9 if due else None

    def _take_in(self, direction: Direction) -> bool:
        """Read what is there; return whether there may be more, some time."""
        for _ in range(AT_ONCE):
            try:
                frame = os.read(direction.into, MOST_BYTES)
            except BlockingIOError:
                return True
            except OSError:  # the interface has been removed
                return False
            if not frame:
                return False
            if self._is_simulation(frame):
                self._write(direction.out_of, frame)
            elif direction.loss and self._draws.random() < direction.loss:
                self.lost += 1
            elif direction.take(frame, time.monotonic_ns()):
                self.held += 1
            else:
                self.lost += 1
        return True

    def _give_out(self) -> None:
        now_ns = time.monotonic_ns()
        for direction in self._directions.values():
            while direction.under_way and direction.under_way[0][0] <= now_ns:
                self._write(direction.out_of, direction.under_way.popleft()[1])

    def _is_simulation(self, frame: bytes) -> bool:
        addresses = ADDRESSES.get(frame[12:14], ())
        return any(frame[each] == self._at_once for each in addresses)

    def _write(self, file: int, frame: bytes) -> None:
        try:
            os.write(file, frame)
        except OSError:  # the far end is down, or it is not a frame
            self.lost += 1
