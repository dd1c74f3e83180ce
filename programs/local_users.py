"""The users whose processes are at the other ends of connections by the loopback."""

import sys
import time
from ipaddress import IPv4Address
from pathlib import Path

from programs.timeouts import FRESH_S

CONNECTIONS = Path("/proc/net/tcp")  # proc(5): of this network namespace
OF_MACHINE = Path("/run/qmn/machine-connections")  # the same, of the machine's, inside a run
NOBODY = -1
REST = 4.0  # behind a reading, in durations of one: the kernel needs some 10 ms


def owner(host: str, port: int) -> int:
    return LocalUsers().owner(host, port)


def users_of(connections: str) -> dict[str, int]:
    """Return the users of sockets by local address, from the kernel's table."""
    rows = map(str.split, connections.splitlines()[1:])
    return {row[1]: int(row[7]) for row in rows}


class LocalUsers:
    """The same for many sockets of one listener."""

    def __init__(self) -> None:
        self._users: dict[str, int] = {}
        self._begun_s = self._ended_s = self._next_s = -FRESH_S

    def owner(self, host: str, port: int) -> int:
        """Return the user of a socket; NOBODY if it is gone, or newer than what could be read."""
        place = f"{int.from_bytes(IPv4Address(host).packed, sys.byteorder):08X}:{port:04X}"
        now_s = time.monotonic()
        is_known = place in self._users and now_s < self._ended_s + FRESH_S
        if not is_known and now_s >= self._next_s:
            tables = [file.read_text() for file in (OF_MACHINE, CONNECTIONS) if file.exists()]
            self._users = {at: user for table in tables for at, user in users_of(table).items()}
            self._begun_s, self._ended_s = now_s, time.monotonic()
        return self._users.get(place, NOBODY)

    def rest(self) -> None:
        """Read no more for a while, as refused peers may come back at once."""
        self._next_s = self._ended_s + REST * (self._ended_s - self._begun_s)
