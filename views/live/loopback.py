"""A port on this machine's loopback that leads to a socket, at which a container serves a page.

    python -m views.live.loopback PORT SOCKET     0: a port that is free

It runs in a container that has the machine's network and shares the socket's folder with the one
that serves, which has no network (docker/run). It says which port it is, and ends with its input.
"""

import asyncio
import os
import signal
import socket
import sys
from functools import partial

from programs.connection_shares import StreamServer
from programs.relay import CHUNK_BYTES, relay
from views.live.address import LOOPBACK


async def main(port: int, path: str) -> None:
    """Lead every connection to the socket until there is no more input."""
    # Ctrl-C ends the network, whose last words the page shows.
    asyncio.get_running_loop().add_signal_handler(signal.SIGINT, lambda: None)
    listener = socket.create_server((LOOPBACK, port))
    print(listener.getsockname()[1], flush=True)
    connect = partial(asyncio.open_unix_connection, path)
    server = StreamServer(lambda *ends: relay(connect, ends), listener)
    await asyncio.to_thread(until_the_end_of_input)
    server.close()


def until_the_end_of_input() -> None:
    """Read what is given to read; it says nothing."""
    while os.read(sys.stdin.fileno(), CHUNK_BYTES):
        pass


if __name__ == "__main__":
    try:
        asyncio.run(main(int(sys.argv[1]), sys.argv[2]))
    except OSError as error:
        sys.exit(f"qmn: {error}: QMN_LIVE_PORT names another one")
