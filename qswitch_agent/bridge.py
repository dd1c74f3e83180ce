"""The agent's own connections to its bridge: one watches flow table and ports, one commands.

Two, because Open vSwitch's flow monitor abbreviates changes made on its own connection.

The fibres' supervisory channels: the packets that accompany the light, which are LLDP alone.

The bridge forwards no packet into a fibre (OFPPC_NO_FWD); what a controller sends there by
PACKET_OUT the agent puts onto the link itself.
"""

import asyncio
import contextlib
import itertools
import logging
import socket
from collections.abc import Callable, Iterable
from dataclasses import replace

from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import flow_reports, flows, messages, packets, ports
from qswitch_agent.openflow.flow_reports import FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry
from qswitch_agent.openflow.messages import Framer
from qswitch_agent.openflow.ports import Port, PortMod
from qswitch_agent.timeouts import BARRIER_DEADLINE_S
from wire.malformed import MalformedPacket

CHUNK = 1 << 16
NO_PACKETS = ofp.OFPPC_NO_FWD
log = logging.getLogger(__name__)


class BridgeFault(Exception):
    """The bridge cannot be watched (any more); the message names cause and remedy."""


class Connection:
    """An OpenFlow connection to the bridge's management socket."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._barriers: dict[int, asyncio.Future[None]] = {}
        self._xids = itertools.count(3)
        self._ended = ""  # why nothing is read any more

    async def open(self) -> None:
        """Connect; raise BridgeFault if there is no bridge."""
        try:
            self._reader, self._writer = await asyncio.open_unix_connection(self._path)
        except OSError as error:
            raise BridgeFault(
                f"no bridge at {self._path}: {error.strerror}; start the bridge before its agent"
            ) from error
        self._writer.write(messages.hello())

    async def run(self) -> None:
        """Take in what the bridge says until the connection ends; raise BridgeFault then."""
        try:
            await self._read()
        except BridgeFault as fault:
            self._end(str(fault))
            raise
        except asyncio.CancelledError:
            self._end("the agent ends")
            raise

    def _end(self, reason: str) -> None:
        """Let nobody wait for barriers any more."""
        self._ended = reason
        for reply in self._barriers.values():
            if not reply.done():
                reply.set_exception(BridgeFault(reason))

    async def _read(self) -> None:
        framer = Framer()
        try:
            while data := await self._reader.read(CHUNK):
                for message in framer.feed(data):
                    self._take(messages.require_version(message))
        except (MalformedPacket, OSError) as error:
            raise BridgeFault(f"bridge at {self._path}: {error}") from error
        raise BridgeFault(f"bridge at {self._path} is gone; start bridge and agent again")

    async def barrier(self) -> None:
        """Return when the bridge has done all that was asked for up to now."""
        if self._ended:
            raise BridgeFault(self._ended)
        xid = next(self._xids)
        reply = asyncio.get_running_loop().create_future()
        self._barriers[xid] = reply
        self._writer.write(messages.encode(ofp.OFPT_BARRIER_REQUEST, xid))
        try:
            async with asyncio.timeout(BARRIER_DEADLINE_S):
                await reply
        except TimeoutError as error:
            raise BridgeFault(
                f"bridge at {self._path} did not answer a barrier in {BARRIER_DEADLINE_S} s"
            ) from error
        finally:
            del self._barriers[xid]

    def close(self) -> None:
        self._writer.close()

    def _take(self, message: bytes) -> None:
        kind = messages.message_type(message)
        xid = messages.transaction_id(message)
        if kind == ofp.OFPT_BARRIER_REPLY:
            if xid in self._barriers and not self._barriers[xid].done():
                self._barriers[xid].set_result(None)
        elif kind == ofp.OFPT_ECHO_REQUEST:
            body = message[messages.HEADER.size :]
            self._writer.write(messages.encode(ofp.OFPT_ECHO_REPLY, xid, body))
        else:
            self._hear(message)

    def _hear(self, message: bytes) -> None:
        """Take in a message that is neither a barrier's reply nor an echo."""


class Monitor(Connection):
    """A flow monitor, and the state of the ports."""

    def __init__(
        self,
        path: str,
        on_updates: Callable[[list[FlowUpdate]], None],
        on_ports: Callable[[list[Port]], None],
    ) -> None:
        """Hand each batch of changes of the flow table and of the ports over, in order.

        Simultaneous changes of the bridge, as by a bundle, are one batch.
        """
        super().__init__(path)
        self._on_updates = on_updates
        self._on_ports = on_ports
        self._batch: list[FlowUpdate] = []
        self._complete = asyncio.Event()  # clear while Open vSwitch leaves updates out
        self._complete.set()

    async def open(self) -> None:
        """Connect and ask for flow table and ports; raise BridgeFault if there is no bridge."""
        await super().open()
        self._writer.write(flow_reports.flow_monitor_request(1) + ports.port_watch(2))

    async def synchronise(self) -> None:
        """Return when every change up to now has been handed over.

        Open vSwitch queues the monitor's updates before it answers the change itself,
        and a barrier's reply comes behind them on the same connection.
        """
        await self.barrier()
        try:
            async with asyncio.timeout(BARRIER_DEADLINE_S):
                await self._complete.wait()
        except TimeoutError as error:
            raise BridgeFault(
                f"bridge at {self._path} paused its flow monitor for {BARRIER_DEADLINE_S} s"
            ) from error

    def _hear(self, message: bytes) -> None:
        kind = messages.message_type(message)
        if kind == ofp.OFPT_MULTIPART_REPLY:
            if messages.multipart_type(message) == ofp.OFPMP_PORT_DESC:
                self._on_ports(ports.described_ports(message))
            else:
                self._take_updates(message)
        elif kind == ofp.OFPT_PORT_STATUS:
            gone = ports.status_reason(message) == ofp.OFPPR_DELETE
            described = ports.described_ports(message)
            self._on_ports([replace(port, gone=gone) for port in described])
        elif kind == ofp.OFPT_ERROR:
            raise BridgeFault(
                f"bridge at {self._path} refuses to be watched: OpenFlow error type and "
                f"code {messages.error_code(message)}; it must be Open vSwitch 3.1 or newer "
                "with OpenFlow14 among its protocols"
            )

    def _take_updates(self, message: bytes) -> None:
        updates = flow_reports.flow_updates(message)
        for update in updates:
            if update.event == flow_reports.PAUSED:
                log.warning("the bridge pauses its flow monitor: too many changes at once")
                self._complete.clear()
            elif update.event == flow_reports.RESUMED:
                self._complete.set()
        self._batch += updates
        if self._batch and not messages.more_follows(message):
            batch, self._batch = self._batch, []
            self._on_updates(batch)


class Commands(Connection):
    """Changes that the agent itself makes in the bridge."""

    def delete(self, entry: FlowEntry) -> None:
        self._writer.write(flows.delete_strict(entry, next(self._xids)))

    def send_from(self, port: int, frame: bytes) -> None:
        """Let the bridge's own entries decide on a frame that comes from a port."""
        self._writer.write(packets.by_the_table(port, frame, next(self._xids)))

    def keep_packets_out(self, port: Port) -> None:
        """Let the bridge forward no packet into a port, not even when it floods."""
        self._configure(port, NO_PACKETS)

    def announce(self, port: Port) -> None:
        """Have the bridge send PORT_STATUS to those controllers that want to hear of a port.

        It does so when the configuration changes; so it is changed, and changed back.
        """
        self._configure(port, 0)
        self._configure(port, NO_PACKETS)

    def _configure(self, port: Port, config: int) -> None:
        mod = PortMod(port.number, port.address, config, NO_PACKETS)
        self._writer.write(mod.encode(next(self._xids)))

    def _hear(self, message: bytes) -> None:
        if messages.message_type(message) == ofp.OFPT_ERROR:
            log.error("the bridge refuses what the agent asks: %s", messages.error_code(message))


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
