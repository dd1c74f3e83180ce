"""The users whose processes are at the other ends of connections by the loopback."""

import sys
from ipaddress import IPv4Address
from pathlib import Path

CONNECTIONS = Path("/proc/net/tcp")  # proc(5): of this network namespace
NOBODY = -1


def owner(host: str, port: int) -> int:
    return owner_of(host, port, CONNECTIONS.read_text())


def owner_of(host: str, port: int, connections: str) -> int:
    """Return the same from the kernel's table; NOBODY if it is not there."""
    wanted = f"{int.from_bytes(IPv4Address(host).packed, sys.byteorder):08X}:{port:04X}"
    for line in connections.splitlines()[1:]:
        fields = line.split()
        if fields[1] == wanted:
            return int(fields[7])
    return NOBODY
