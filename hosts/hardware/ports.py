"""The fibre ports of a host as its kernel sees them."""

import errno
import socket
from collections.abc import Iterable
from pathlib import Path

from wire.device import DevicePort

INTERFACES = Path("/sys/class/net")
RTMGRP_LINK = 1  # of rtnetlink(7)
NOTICE_BYTES = 1 << 16


def read_ports(names: Iterable[str]) -> tuple[DevicePort, ...]:
    """Return which fibre ports have light: a cut fibre has none, nor has one that is gone."""
    return tuple(DevicePort(name, _is_up(name)) for name in names)


def _is_up(name: str) -> bool:
    try:
        # A link between machines (VXLAN) does not know, except when it was set down.
        return (INTERFACES / name / "operstate").read_text().strip() in ("up", "unknown")
    except OSError:
        return False


def link_changes() -> socket.socket:
    kind = socket.SOCK_RAW | socket.SOCK_NONBLOCK
    changes = socket.socket(socket.AF_NETLINK, kind, socket.NETLINK_ROUTE)
    changes.bind((0, RTMGRP_LINK))
    return changes


def take_notices(changes: socket.socket) -> None:
    """Read what has come, of which it counts alone that something has."""
    while True:
        try:
            changes.recv(NOTICE_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno != errno.ENOBUFS:  # there were too many, and some are lost
                raise
