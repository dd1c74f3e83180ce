"""Connections that are passed on to others."""

import asyncio
import socket
import struct
from typing import Any

import pytest
import uvloop
from limits import SOON_S

from programs.relay import relay

LINGER_NOT = struct.pack("ii", 1, 0)  # socket(7): close with a reset


@pytest.mark.parametrize("loop", [asyncio.new_event_loop, uvloop.new_event_loop])
def test_a_relay_ends_if_the_near_end_resets_and_the_far_end_closes_later(loop: Any) -> None:
    async def scene() -> None:
        ended: asyncio.Future[BaseException | None] = asyncio.get_running_loop().create_future()
        reset = asyncio.Event()

        async def far(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reset.wait()
            writer.close()

        async def near(*ends: Any) -> None:
            results = await asyncio.gather(
                relay(lambda: asyncio.open_connection(*place), ends), return_exceptions=True
            )
            ended.set_result(results[0])

        server = await asyncio.start_server(far, "127.0.0.1", 0)
        place = server.sockets[0].getsockname()
        entrance = await asyncio.start_server(near, "127.0.0.1", 0)
        client = socket.create_connection(entrance.sockets[0].getsockname())
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER_NOT)
        await asyncio.sleep(0)
        client.close()
        reset.set()
        async with asyncio.timeout(SOON_S):
            assert await ended is None
        server.close()
        entrance.close()

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(scene())


def test_what_was_read_before_the_far_end_was_reached_comes_first() -> None:
    async def scene() -> bytes:
        heard: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()

        async def far(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            heard.set_result(await reader.read())
            writer.close()

        server = await asyncio.start_server(far, "127.0.0.1", 0)
        place = server.sockets[0].getsockname()
        own, client = socket.socketpair()
        with client:
            near = await asyncio.open_connection(sock=own)
            client.sendall(b" world")
            client.shutdown(socket.SHUT_WR)
            async with server, asyncio.timeout(SOON_S):
                await relay(lambda: asyncio.open_connection(*place), near, b"hello")
                return await heard

    assert asyncio.run(scene()) == b"hello world"
