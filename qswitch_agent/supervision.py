"""The fibres' supervisory channels: the packets that accompany the light, which are LLDP alone.

The bridge forwards no packet into a fibre (OFPPC_NO_FWD); what a controller sends there by
PACKET_OUT the agent puts onto the link itself.
"""

import contextlib
import logging
import socket
from collections.abc import Iterable

from qswitch_agent.bridge import NO_PACKETS, Commands
from qswitch_agent.openflow.ports import Port

log = logging.getLogger(__name__)


class SupervisoryChannels:
    """The fibre ports as links that packets could take."""

    def __init__(self, fibers: frozenset[int], commands: Commands) -> None:
        self.ports: dict[int, Port] = {}  # the fibre ports by number
        self._fibers = fibers
        self._commands = commands
        self._sockets: dict[str, socket.socket] = {}

    def update(self, ports: Iterable[Port]) -> None:
        for port in ports:
            if port.number in self._fibers:
                self.ports[port.number] = port
                if not port.config & NO_PACKETS:
                    self._commands.keep_packets_out(port)

    def send(self, number: int, frame: bytes) -> None:
        """Send a frame into a fibre; a fibre that is cut takes it and says nothing."""
        name = self.ports[number].name
        try:
            self._socket(name).send(frame)
        except OSError as error:
            log.debug("port %d (%s): %s", number, name, error)
            with contextlib.suppress(KeyError):
                self._sockets.pop(name).close()  # the interface may be another one by now

    def announce(self, numbers: Iterable[int]) -> None:
        for number in sorted(numbers):
            if number in self.ports:
                self._commands.announce(self.ports[number])

    def close(self) -> None:
        for channel in self._sockets.values():
            channel.close()

    def _socket(self, name: str) -> socket.socket:
        if name not in self._sockets:
            channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
            self._sockets[name] = channel
            channel.setblocking(False)
            channel.bind((name, 0))
        return self._sockets[name]
