"""The OpenFlow proxy between the bridge and a controller.

    bridge --- agent --- controller      messages pass unchanged, in order

A BARRIER_REPLY waits until the light paths are ready, and what the bridge says after it
waits behind it. If they do not get ready, the controller gets an ERROR in its place.
"""

import asyncio
import contextlib
import logging
from asyncio import StreamReader, StreamWriter
from collections.abc import Awaitable, Callable

from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent import openflow
from qswitch_agent.light_paths import NotReady
from qswitch_agent.openflow import Framer
from wire.metadata import MalformedPacket

CHUNK = 1 << 16
HOLD_DEADLINE_S = 5.0
FIRST_RETRY_S, LAST_RETRY_S = 0.05, 1.0
CLOSE_DEADLINE_S = 0.5
log = logging.getLogger(__name__)

Address = tuple[str, int]


class Proxy:
    """Serves the bridge's connections for one controller."""

    def __init__(
        self,
        controller: Address,
        paths_ready: Callable[[], Awaitable[None]],
        hold_deadline_s: float = HOLD_DEADLINE_S,
    ) -> None:
        """Hold each barrier's reply until paths_ready returns, or raises NotReady."""
        self._controller = controller
        self._paths_ready = paths_ready
        self._hold_deadline_s = hold_deadline_s
        self._server: asyncio.Server | None = None
        self._connections: set[asyncio.Task[None]] = set()
        self._held: set[asyncio.Task[None]] = set()

    async def serve(self, listen: Address) -> None:
        """Accept the bridge's connections from now on; raise OSError if the port is taken."""
        self._server = await asyncio.start_server(self._accept, *listen)

    async def close(self) -> None:
        """Stop, after the replies that wait have had a moment to be decided."""
        if self._server is not None:
            self._server.close()
        if self._held:
            await asyncio.wait(self._held, timeout=CLOSE_DEADLINE_S)
        for connection in self._connections:
            connection.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    def _accept(self, reader: StreamReader, writer: StreamWriter) -> None:
        connection = asyncio.create_task(self._connect(reader, writer))
        self._connections.add(connection)
        connection.add_done_callback(self._connections.discard)

    async def _connect(self, reader: StreamReader, writer: StreamWriter) -> None:
        """Connect the bridge to the controller until either of them ends it."""
        with contextlib.closing(writer):
            reached = await self._reach_controller(reader)
            if reached is None:
                return
            greeting, controller_reader, controller_writer = reached
            with contextlib.closing(controller_writer):
                log.info("bridge and controller %s:%d are connected", *self._controller)
                await self._pass_messages(
                    self._from_bridge(reader, controller_writer, greeting),
                    self._from_controller(controller_reader, writer),
                )

    async def _reach_controller(
        self, bridge: StreamReader
    ) -> tuple[bytes, StreamReader, StreamWriter] | None:
        """Return what the bridge has said meanwhile, and the connection; None if it left."""
        said = b""
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
                    said += reading.result()
                if not dial.done() and (bridge.at_eof() or bridge.exception()):
                    return None
            return said, *dial.result()
        finally:
            dial.cancel()

    async def _dial(self) -> tuple[StreamReader, StreamWriter]:
        """Connect to the controller, however long it takes to come up."""
        pause_s = FIRST_RETRY_S
        while True:
            try:
                return await asyncio.open_connection(*self._controller)
            except OSError as error:
                if pause_s == FIRST_RETRY_S:
                    log.warning("waiting for controller %s:%d: %s", *self._controller, error)
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, LAST_RETRY_S)

    async def _pass_messages(self, *directions: Awaitable[str]) -> None:
        tasks = [asyncio.ensure_future(direction) for direction in directions]
        try:
            done, _pending = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
        log.info("connection ended: %s", " and ".join(sorted(t.result() for t in done)))

    async def _from_controller(self, reader: StreamReader, writer: StreamWriter) -> str:
        framer = Framer()
        try:
            while data := await reader.read(CHUNK):
                writer.write(b"".join(framer.feed(data)))
                await writer.drain()
        except (MalformedPacket, OSError) as error:
            return f"messages of the controller: {error}"
        return "the controller closed it"

    async def _from_bridge(
        self, reader: StreamReader, writer: StreamWriter, greeting: bytes
    ) -> str:
        framer = Framer()
        try:
            await self._forward(framer.feed(greeting), writer)
            while data := await reader.read(CHUNK):
                await self._forward(framer.feed(data), writer)
                await writer.drain()
        except (MalformedPacket, OSError) as error:
            return f"messages of the bridge: {error}"
        return "the bridge closed it"

    async def _forward(self, messages: list[bytes], writer: StreamWriter) -> None:
        """Send messages on, from the first barrier's reply on only when the paths are ready."""
        kinds = [openflow.message_type(message) for message in messages]
        if ofp.OFPT_BARRIER_REPLY not in kinds:
            writer.write(b"".join(messages))
            return
        first = kinds.index(ofp.OFPT_BARRIER_REPLY)
        writer.write(b"".join(messages[:first]))
        held = asyncio.create_task(self._release(messages[first:], writer))
        self._held.add(held)
        held.add_done_callback(self._held.discard)
        await held

    async def _release(self, messages: list[bytes], writer: StreamWriter) -> None:
        """Send what was held: one wait covers all, because the bridge has answered them all."""
        try:
            async with asyncio.timeout(self._hold_deadline_s):
                await self._paths_ready()
        except (NotReady, TimeoutError) as error:
            reason = str(error) or f"light paths were not ready in {self._hold_deadline_s} s"
            log.error("barrier refused: %s", reason)
            messages = [_refused(message) for message in messages]
        writer.write(b"".join(messages))


def _refused(message: bytes) -> bytes:
    if openflow.message_type(message) == ofp.OFPT_BARRIER_REPLY:
        return openflow.barrier_error(message)
    return message
