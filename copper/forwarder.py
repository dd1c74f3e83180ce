"""Cables of some length: what goes in at one end comes out at the other after the delay.

    alice-eth0 --(TAP)--> Forwarder, a queue for each direction --(TAP)--> s1-eth1

Both ends are TAP interfaces, whose other sides are files that this process holds. A packet is due
by when it was read, which is after it was sent, so that none is ever early. What the simulation
itself says, to and from the dispatcher's address, is held back by no cable.
"""

import os
import random
import select
import time
from collections import deque
from dataclasses import dataclass, field
from ipaddress import IPv4Address

from wire.config import CopperConfig

MOST_BYTES = 1 << 16
AT_ONCE = 64  # frames read from one end before others have their turn
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
    under_way: deque[tuple[int, bytes]] = field(default_factory=deque)  # when due, what


class Forwarder:
    """Moves packets between the ends of cables."""

    def __init__(self, config: CopperConfig) -> None:
        """Take over the files of the ends; raise OSError if one is not there."""
        self._directions: dict[int, Direction] = {}
        self._at_once = IPv4Address(config.simulation).packed
        for cable in config.cables:
            delay_ns = round(config.time.wall_s(cable.delay_s) * 1e9)
            for into, out_of in ((cable.a_fd, cable.b_fd), (cable.b_fd, cable.a_fd)):
                os.set_blocking(into, False)
                self._directions[into] = Direction(into, out_of, delay_ns, cable.loss)
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
            else:
                self.held += 1
                direction.under_way.append((time.monotonic_ns() + direction.delay_ns, frame))
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
        except OSError:  # the far end is down, or the frame is none
            self.lost += 1
