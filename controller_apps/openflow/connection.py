"""The connections of switches: a share for each peer, and fewer system calls than Ryu makes.

Ryu asks for each message twice, for its header and for the rest, and hands what it sends to a green
thread that waits for it. At each wait the scheduler looks at all sockets.
"""

from collections.abc import Callable
from typing import Any

from controller_apps.timeouts import NO_FILES_WAIT_S
from programs.connection_shares import NO_FILES, PeerShares

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
        """Return what has come, at most so many bytes, none at the end; wait if nothing has."""
        if self._read == len(self._ahead):
            if len(self._ahead) == AT_ONCE:  # there may be more, and other switches wait
                self._give_way()
            self._ahead, self._read = self._socket.recv(AT_ONCE), 0
        part = self._ahead[self._read : self._read + most]
        self._read += len(part)
        return part

    def send_now(self, data: bytes | bytearray) -> int:
        """Return how many bytes the other end's buffer takes; none if the connection has failed.

        Who waits until it takes the rest is told of the failure.
        """
        try:
            sent: int = self._socket.fd.send(data)
        except OSError:  # full (EAGAIN), or failed
            return 0
        return sent
