"""Serves the connections between the bridge and controllers, message by message.

    bridge --- agent --- controller

Messages keep their order in each direction. A BARRIER_REPLY waits until the light paths are
ready, and what the bridge says after it waits behind it. For what does not get ready, the
controller gets an ERROR with the xid of its FLOW_MOD before the reply.
"""

import asyncio
import contextlib
import logging
import socket
import ssl
import time
from asyncio import StreamReader, StreamWriter
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from programs.connection_shares import StreamServer
from qswitch_agent.bridge import BridgeFault
from qswitch_agent.hardware.optics import HardwareFault
from qswitch_agent.openflow.messages import Framer, require_version
from qswitch_agent.proxy.link import Link, Outgoing
from qswitch_agent.proxy.replies import Replies
from qswitch_agent.proxy.requests import Requests
from qswitch_agent.switch import Switch
from qswitch_agent.timeouts import CLOSE_DEADLINE_S, FIRST_RETRY_S, HOLD_DEADLINE_S, LAST_RETRY_S
from wire.malformed import MalformedPacket

CHUNK = 1 << 16
log = logging.getLogger(__name__)

Address = tuple[str, int]
Ends = tuple[StreamReader, StreamWriter]


class Server:
    """Serves connections: each is passed on between the bridge and a controller."""

    def __init__(self, switch: Switch, hold_deadline_s: float = HOLD_DEADLINE_S) -> None:
        """Hold each barrier's reply until the switch is ready, or the deadline has passed."""
        self._switch = switch
        self._hold_deadline_s = hold_deadline_s
        self.batches = True  # replies wait for others, to go in one write
        self._server: asyncio.Server | StreamServer | None = None
        self._connections: set[asyncio.Task[None]] = set()
        self._links: set[Link] = set()

    async def serve(self, listen: Address | str) -> None:
        """Accept connections from now on, at an address or at the path of a Unix socket.

        The socket is for this user alone. Raise OSError if the port is taken.
        """
        if isinstance(listen, str):
            self._server = await asyncio.start_unix_server(self._accept, listen)
            Path(listen).chmod(0o600)
        else:
            self._server = StreamServer(self._accept, socket.create_server(listen))

    async def close(self) -> None:
        """Stop, after the replies that wait have had a moment to be decided."""
        if self._server is not None:
            self._server.close()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(CLOSE_DEADLINE_S):
                for link in list(self._links):
                    await link.settle()
        for connection in self._connections:
            connection.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    def _accept(self, reader: StreamReader, writer: StreamWriter) -> None:
        connection = asyncio.create_task(self._connect(reader, writer))
        self._connections.add(connection)
        connection.add_done_callback(self._connections.discard)

    async def _connect(self, reader: StreamReader, writer: StreamWriter) -> None:
        """Connect a peer to the other side, until either of them ends it."""
        raise NotImplementedError

    async def _pass_on(self, bridge: Ends, controller: Ends, greeting: bytes = b"") -> None:
        """Pass messages on until one side ends; the bridge has begun with a greeting."""
        (reader, writer), (controller_reader, controller_writer) = bridge, controller
        link = Link(writer, controller_writer, self.batches)
        self._switch.connections.add(link)
        self._links.add(link)
        try:
            await _first_end(
                self._hear(link, greeting, reader),
                self._show(link),
                self._ask(link, controller_reader),
            )
        finally:
            self._links.discard(link)
            self._switch.connections.discard(link)
            link.close()

    async def _ask(self, link: Link, reader: StreamReader) -> str:
        requests, framer = Requests(self._switch, link), Framer()
        try:
            while data := await reader.read(CHUNK):
                for message in framer.feed(data):
                    await requests.take(message)
                link.flush()
                await link.bridge.drain()
        except (MalformedPacket, OSError) as error:
            return f"messages of the controller: {error}"
        except (BridgeFault, HardwareFault) as fault:
            return f"a request of the controller: {fault}"
        return "the controller closed it"

    async def _hear(self, link: Link, greeting: bytes, reader: StreamReader) -> str:
        """Take in what the bridge says; what is for the controller waits for its turn."""
        framer, data = Framer(), greeting
        try:
            while data or (data := await reader.read(CHUNK)):
                now_ns = time.monotonic_ns()
                for message in framer.feed(data):
                    if not link.is_ours(require_version(message)):
                        await link.outgoing.put(Outgoing(message, now_ns))
                data = b""
        except (MalformedPacket, OSError) as error:
            return f"messages of the bridge: {error}"
        await link.outgoing.join()
        return "the bridge closed it"

    async def _show(self, link: Link) -> str:
        """Pass on messages of the bridge, as soon as they are true of light, too.

        Messages that are due at once go in one write, which costs more than the rest; those
        before a barrier's reply go with it, if that comes soon.
        """
        replies = Replies(self._switch, link, self._hold_deadline_s)
        try:
            while True:
                message, since_ns, by_agent = await link.outgoing.get()
                if not by_agent:
                    if replies.may_wait(message):
                        link.show_soon()
                    message = await replies.shown(message, since_ns)
                link.to_controller(link.failed() + message)
                if link.outgoing.empty() and link.owes_barrier:
                    link.show_soon()
                elif link.outgoing.empty():
                    link.show()
                    await link.controller.drain()
        except (MalformedPacket, OSError) as error:
            return f"messages to the controller: {error}"
        except (BridgeFault, HardwareFault) as fault:
            return f"what the bridge says: {fault}"


class Proxy(Server):
    """Serves the bridge's connections for one controller."""

    def __init__(
        self,
        controller: Address,
        switch: Switch,
        tls: ssl.SSLContext | None = None,
        hold_deadline_s: float = HOLD_DEADLINE_S,
    ) -> None:
        """Hold each barrier's reply until the switch is ready, or the deadline has passed.

        The controller is reached by TLS, if there is a context for it.
        """
        super().__init__(switch, hold_deadline_s)
        self._controller, self._tls = controller, tls

    async def _connect(self, reader: StreamReader, writer: StreamWriter) -> None:
        with contextlib.closing(writer):
            reached = await self._reach_controller(reader)
            if reached is None:
                return
            greeting, controller = reached[0], reached[1:]
            with contextlib.closing(controller[1]):
                log.info("bridge and controller %s:%d are connected", *self._controller)
                await self._pass_on((reader, writer), controller, greeting)

    async def _reach_controller(
        self, bridge: StreamReader
    ) -> tuple[bytes, StreamReader, StreamWriter] | None:
        """Return the messages of the bridge meanwhile, and the connection; None if it left."""
        greeting = b""
        dial = asyncio.create_task(self._dial())
        try:
            while not dial.done():
                reading = asyncio.create_task(bridge.read(CHUNK))
                try:
                    await asyncio.wait({dial, reading}, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    reading.cancel()
                    await asyncio.wait({reading})
                if not reading.cancelled() and reading.exception() is None:
                    greeting += reading.result()
                if not dial.done() and (bridge.at_eof() or bridge.exception()):
                    return None
            return greeting, *dial.result()
        except asyncio.CancelledError:
            if dial.done():
                dial.result()[1].close()
            raise
        finally:
            dial.cancel()

    async def _dial(self) -> tuple[StreamReader, StreamWriter]:
        """Connect to the controller, however long it takes to come up."""
        pause_s = FIRST_RETRY_S
        while True:
            try:
                return await asyncio.open_connection(*self._controller, ssl=self._tls)
            except OSError as error:
                if pause_s == FIRST_RETRY_S:
                    log.warning("waiting for controller %s:%d: %s", *self._controller, error)
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, LAST_RETRY_S)


class Programs(Server):
    """Serves programs such as ovs-ofctl: to them, too, the bridge is an optical switch."""

    def __init__(self, management: str, switch: Switch) -> None:
        """Name the bridge's management socket, to which each program gets a connection."""
        super().__init__(switch)
        self._management = management

    async def _connect(self, reader: StreamReader, writer: StreamWriter) -> None:
        with contextlib.closing(writer):
            try:
                bridge = await asyncio.open_unix_connection(self._management)
            except OSError as error:
                log.warning("no bridge for a program at %s: %s", self._management, error)
                return
            with contextlib.closing(bridge[1]):
                await self._pass_on(bridge, (reader, writer))


async def _first_end(*directions: Coroutine[Any, Any, str]) -> None:
    tasks = [asyncio.create_task(direction) for direction in directions]
    try:
        done, _pending = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
    log.info("connection ended: %s", " and ".join(sorted(task.result() for task in done)))
