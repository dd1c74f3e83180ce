"""A port on this machine's loopback that leads to a socket, at which a container serves a page.

    python -m qmn.live_view.loopback PORT SOCKET     0: a port that is free

It runs in a container that has the machine's network and shares the socket's folder with the one
that serves, which has no network (docker/run). It says which port it is, and ends with its input.
"""

import asyncio
import os
import signal
import socket
import sys

from programs.connection_shares import StreamServer
from qmn.live_view.address import LOOPBACK

CHUNK = 1 << 16  # bytes


async def main(port: int, path: str) -> None:
    """Lead every connection to the socket until there is no more input."""
    # Ctrl-C ends the network, whose last words the page shows.
    asyncio.get_running_loop().add_signal_handler(signal.SIGINT, lambda: None)
    listener = socket.create_server((LOOPBACK, port))
    print(listener.getsockname()[1], flush=True)
    server = StreamServer(lambda *ends: joined(path, *ends), listener)
    await asyncio.to_thread(until_the_end_of_input)
    server.close()


def until_the_end_of_input() -> None:
    """Read what is given to read; it says nothing."""
    while os.read(sys.stdin.fileno(), CHUNK):
        pass


async def joined(
    path: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, begun: bytes = b""
) -> None:
    """Join a connection with the socket until both ends are closed, or one is lost.

    What has been read of it already goes first.
    """
    try:
        inner_reader, inner_writer = await asyncio.open_unix_connection(path)
    except OSError:  # nothing is served yet, or any more: as where nobody listens
        writer.close()
        return
    inner_writer.write(begun)
    try:
        await asyncio.gather(passed_on(reader, inner_writer), passed_on(inner_reader, writer))
    finally:
        writer.close()
        inner_writer.close()


async def passed_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass bytes on, and that there are no more, or that nobody takes them."""
    try:
        while data := await reader.read(CHUNK):
            writer.write(data)
            await writer.drain()
        writer.write_eof()
    except ConnectionError:
        writer.transport.abort()


if __name__ == "__main__":
    try:
        asyncio.run(main(int(sys.argv[1]), sys.argv[2]))
    except OSError as error:
        sys.exit(f"qmn: {error}: QMN_LIVE_PORT names another one")
