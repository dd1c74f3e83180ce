"""The connections of switches: a share for each peer, and fewer system calls than Ryu makes.

Ryu asks for each message twice, for its header and for the rest, and hands what it sends to a green
thread that waits for it. At each wait the scheduler looks at all sockets.

The connection that speaks for a switch: the first of its datapath id, for as long as it lasts.

A later switch with the same id is refused, and does not displace it. A connection by the
controller's own loopback has to be of a process of root's or of its own user: bridges and agents
are, and no other local user can be a switch, not even before the real one is here.
"""

import logging
import os
from collections.abc import Callable
from ipaddress import IPv4Address
from typing import Any

from controller_apps.timeouts import NO_FILES_WAIT_S
from programs import connection_shares
from programs.connection_shares import NO_FILES, PeerShares

ROOT = 0

log = logging.getLogger("speakers")


class Speakers:
    """The connections that speak for switches, by datapath id."""

    def __init__(self, dead: str, owner_of: Callable[[Any], int | None]) -> None:
        """`dead` is the state of a connection that has ended; owner_of gives its other end's user.

        None: it is of another machine.
        """
        self._dead, self._owner_of = dead, owner_of
        self._of: dict[int, Any] = {}

    def admits(self, datapath: Any, dpid: int) -> bool:
        """Tell whether a connection speaks for a switch; end one that does not."""
        speaker = self._of.get(dpid)
        if speaker is datapath:
            return True
        if datapath.state == self._dead:
            return False
        if speaker is not None and speaker.state != self._dead:
            self._send_away(datapath, dpid, "which is connected already")
            return False
        owner = self._owner_of(datapath)
        if owner not in (None, ROOT, os.geteuid()):
            self._send_away(datapath, dpid, f"as a process of user {owner}")
            return False
        self._of[dpid] = datapath
        return True

    def _send_away(self, datapath: Any, dpid: int, cause: str) -> None:
        log.warning("%s poses as switch %#x, %s: sent away", datapath.address, dpid, cause)
        datapath.close()


def owner(datapath: Any) -> int | None:
    """Return the user of the process at the other end of a connection, None if it is not here."""
    host, port = datapath.address[:2]
    if not IPv4Address(host).is_loopback:
        return None
    return connection_shares.owner(host, port)


AT_ONCE = 1 << 14  # bytes: about a hundred packets that a switch sends up


class SharedAccept:
    """A framework's listening socket that closes connections beyond their peer's share."""

    def __init__(self, listener: Any, sleep: Callable[[float], None]) -> None:
        self._listener, self._sleep, self._shares = listener, sleep, PeerShares()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._listener, name)

    def accept(self) -> tuple[Any, Any]:
        """Wait for a connection; return it and its peer's address."""
        while True:
            try:
                connection, address = self._listener.accept()
            except OSError as error:
                if error.errno not in NO_FILES:
                    raise
                self._sleep(NO_FILES_WAIT_S)
                continue
            if self._shares.admits(connection, address):
                return connection, address
            connection.close()
            self._sleep(0)


class Connection:
    """A socket of eventlet that reads ahead, and can write without waiting; else as it is."""

    def __init__(self, green_socket: Any, give_way: Callable[[], None]) -> None:
        self._socket, self._give_way = green_socket, give_way
        self._ahead, self._read = b"", 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._socket, name)

    def recv(self, most: int) -> bytes:
        """Return bytes that have come, none at the end; wait if there are none."""
        if self._read == len(self._ahead):
            if len(self._ahead) == AT_ONCE:  # there may be more, and other switches wait
                self._give_way()
            self._ahead, self._read = self._socket.recv(AT_ONCE), 0
        part = self._ahead[self._read : self._read + most]
        self._read += len(part)
        return part

    def send_now(self, data: bytes | bytearray) -> int:
        """Return how many bytes the other end's buffer takes; none if the connection has failed.

        A caller that waits until it takes the rest hears of the failure.
        """
        try:
            sent: int = self._socket.fd.send(data)
        except OSError:  # full (EAGAIN), or failed
            return 0
        return sent
