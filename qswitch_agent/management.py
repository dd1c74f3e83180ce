"""The agent's own connection to its bridge: it watches flow table and ports, no more."""

import asyncio
import itertools
import logging
from collections.abc import Callable

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent import openflow
from qswitch_agent.openflow import FlowUpdate, Framer, PortState
from wire.metadata import MalformedPacket

CHUNK = 1 << 16
BARRIER_DEADLINE_S = 5.0
log = logging.getLogger(__name__)


class BridgeFault(Exception):
    """The bridge cannot be watched (any more); the message names cause and remedy."""


class Management:
    """A flow monitor on the bridge's management socket, and the state of the ports."""

    def __init__(
        self,
        path: str,
        on_updates: Callable[[list[FlowUpdate]], None],
        on_ports: Callable[[list[PortState]], None],
    ) -> None:
        """Hand each batch of changes of the flow table and of the ports over, in order."""
        self._path = path
        self._on_updates = on_updates
        self._on_ports = on_ports
        self._barriers: dict[int, asyncio.Future[None]] = {}
        self._xids = itertools.count(3)
        self._complete = asyncio.Event()  # clear while Open vSwitch leaves updates out
        self._complete.set()

    async def open(self) -> None:
        """Connect and ask for flow table and ports; raise BridgeFault if no bridge is there."""
        try:
            self._reader, self._writer = await asyncio.open_unix_connection(self._path)
        except OSError as error:
            raise BridgeFault(
                f"no bridge at {self._path}: {error.strerror}; start the bridge before its agent"
            ) from error
        requests = openflow.flow_monitor_request(1) + openflow.port_watch(2)
        self._writer.write(openflow.hello() + requests)

    async def run(self) -> None:
        """Take in what the bridge reports until the connection ends; raise BridgeFault then."""
        try:
            await self._read()
        except BridgeFault as fault:
            for reply in self._barriers.values():
                if not reply.done():
                    reply.set_exception(BridgeFault(str(fault)))
            raise

    async def _read(self) -> None:
        framer = Framer()
        try:
            while data := await self._reader.read(CHUNK):
                for message in framer.feed(data):
                    self._take(message)
        except (MalformedPacket, OSError) as error:
            raise BridgeFault(f"bridge at {self._path}: {error}") from error
        raise BridgeFault(f"bridge at {self._path} is gone; start bridge and agent again")

    async def synchronise(self) -> None:
        """Return when every change up to now has been handed over.

        Open vSwitch queues the monitor's updates before it answers the change itself,
        and a barrier's reply comes behind them on the same connection.
        """
        xid = next(self._xids)
        reply = asyncio.get_running_loop().create_future()
        self._barriers[xid] = reply
        self._writer.write(openflow.encode(ofp.OFPT_BARRIER_REQUEST, xid))
        try:
            async with asyncio.timeout(BARRIER_DEADLINE_S):
                await reply
                await self._complete.wait()
        except TimeoutError as error:
            raise BridgeFault(
                f"bridge at {self._path} did not answer a barrier in {BARRIER_DEADLINE_S} s"
            ) from error
        finally:
            del self._barriers[xid]

    def close(self) -> None:
        """Close the connection."""
        self._writer.close()

    def _take(self, message: bytes) -> None:
        kind = openflow.message_type(message)
        xid = openflow.transaction_id(message)
        if kind == ofp.OFPT_MULTIPART_REPLY:
            self._take_updates(openflow.flow_updates(message))
            self._on_ports(openflow.port_states(message))
        elif kind == ofp.OFPT_PORT_STATUS:
            self._on_ports(openflow.port_states(message))
        elif kind == ofp.OFPT_BARRIER_REPLY:
            if xid in self._barriers and not self._barriers[xid].done():
                self._barriers[xid].set_result(None)
        elif kind == ofp.OFPT_ECHO_REQUEST:
            body = message[openflow.HEADER.size :]
            self._writer.write(openflow.encode(ofp.OFPT_ECHO_REPLY, xid, body))
        elif kind == ofp.OFPT_ERROR:
            raise BridgeFault(
                f"bridge at {self._path} refuses to be watched: OpenFlow error type and "
                f"code {openflow.error_code(message)}; it must be Open vSwitch 3.1 or newer "
                "with OpenFlow14 among its protocols"
            )

    def _take_updates(self, updates: list[FlowUpdate]) -> None:
        for update in updates:
            if update.event == openflow.PAUSED:
                log.warning("the bridge pauses its flow monitor: too many changes at once")
                self._complete.clear()
            elif update.event == openflow.RESUMED:
                self._complete.set()
        if updates:
            self._on_updates(updates)
