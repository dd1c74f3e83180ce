"""The controller's entrance for TLS: `python -m controller_apps.tls --config FILE`.

Switches come in with a certificate of the run, each as itself.

    switch === TLS === entrance --- TCP, loopback of c0's namespace --- Ryu or os-ken

It stands before the frameworks because neither writes a key log, neither asks whose certificate a
datapath id comes with, and both read and write one TLS connection from two threads.
"""

import asyncio
import contextlib
import logging
import signal
import socket
import struct
import sys
from asyncio import StreamReader, StreamWriter
from collections.abc import Collection, Coroutine
from typing import Any

import uvloop

from controller_apps.timeouts import CONNECT_TIMEOUT_S
from programs.config_argument import config_path
from programs.connection_shares import StreamServer
from programs.faults import report_fault
from wire.config import BadConfig, EntranceConfig
from wire.credentials import certified_names
from wire.malformed import MalformedPacket

HEADER = struct.Struct("!BBHI")  # of OpenFlow, of any version
FEATURES_REPLY = 6  # of any version, too
DATAPATH_ID = struct.Struct("!Q")  # with which its body begins
CHUNK_BYTES = 1 << 16

log = logging.getLogger("entrance")


class Impostor(Exception):
    """A switch gives itself out as another one than its certificate names."""


class SwitchMessages:
    """Passes whole messages on, and no word of a switch that its certificate does not name."""

    def __init__(self, datapath_ids: Collection[int]) -> None:
        self._datapath_ids = datapath_ids
        self._data = bytearray()

    def feed(self, data: bytes) -> bytes:
        """Return the messages that are whole now; raise Impostor or MalformedPacket."""
        self._data += data
        end = 0
        while len(self._data) - end >= HEADER.size:
            _version, kind, length, _xid = HEADER.unpack_from(self._data, end)
            if length < HEADER.size:
                raise MalformedPacket(f"OpenFlow: a message of {length} bytes")
            if len(self._data) - end < length:
                break
            if kind == FEATURES_REPLY:
                self._identify(bytes(self._data[end + HEADER.size : end + length]))
            end += length
        whole = bytes(self._data[:end])
        del self._data[:end]
        return whole

    def _identify(self, body: bytes) -> None:
        if len(body) < DATAPATH_ID.size:
            raise MalformedPacket(f"OpenFlow: features of {len(body)} bytes")
        (datapath_id,) = DATAPATH_ID.unpack_from(body)
        if datapath_id not in self._datapath_ids:
            raise Impostor(f"poses as switch {datapath_id:#x}")


class Entrance:
    """Takes in switches, and speaks for each with the framework."""

    def __init__(self, config: EntranceConfig) -> None:
        self._config = config
        self._servers: list[StreamServer] = []

    async def open(self) -> None:
        """Take in switches from now on; raise OSError for an address that cannot be had."""
        context = self._config.credentials.server(self._config.key_log)
        for address in self._config.listen:
            host, _, port = address.rpartition(":")
            listener = socket.create_server((host, int(port)))
            server = StreamServer(
                self._welcome, listener, ssl=context, ssl_handshake_timeout=CONNECT_TIMEOUT_S
            )
            self._servers.append(server)

    def close(self) -> None:
        for server in self._servers:
            server.close()

    async def _welcome(self, reader: StreamReader, writer: StreamWriter) -> None:
        names = certified_names(writer.get_extra_info("peercert"))
        datapath_ids = self._config.datapath_ids
        messages = SwitchMessages({datapath_ids[name] for name in names & datapath_ids.keys()})
        host, _, port = self._config.controller.rpartition(":")
        with contextlib.closing(writer):
            try:
                inner = await asyncio.open_connection(host, int(port))
                with contextlib.closing(inner[1]):
                    await first_end(
                        passed_on(reader, inner[1], messages), passed_on(inner[0], writer)
                    )
            except (Impostor, MalformedPacket) as error:
                log.warning("%s, certified as %s: sent away", error, ", ".join(sorted(names)))
            except OSError as error:
                log.info("connection of %s ended: %s", ", ".join(sorted(names)), error)


async def passed_on(
    reader: StreamReader, writer: StreamWriter, messages: SwitchMessages | None = None
) -> None:
    """Pass on what comes until its end; of a switch, whole messages."""
    while data := await reader.read(CHUNK_BYTES):
        writer.write(messages.feed(data) if messages is not None else data)
        await writer.drain()


async def first_end(*directions: Coroutine[Any, Any, None]) -> None:
    """Let both directions run until one of them ends; raise what has ended it."""
    tasks = [asyncio.create_task(direction) for direction in directions]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()


async def serve(config: EntranceConfig) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    entrance = Entrance(config)
    await entrance.open()
    print("ready", flush=True)
    await stop.wait()
    entrance.close()


def main() -> int:
    """Return 0 after a signal, 1 if the entrance cannot be."""
    path = config_path("controller_apps.tls", __doc__)
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(name)s: %(message)s"
    )
    try:
        uvloop.run(serve(EntranceConfig.read(path)))
    except (BadConfig, OSError) as error:
        return report_fault(f"entrance: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
