"""The proxy between a bridge and a controller that are plain loopback sockets."""

import asyncio
from asyncio import StreamReader, StreamWriter
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.light_paths import NotReady
from qswitch_agent.openflow import barrier_error, encode, hello
from qswitch_agent.proxy import Proxy

DEADLINE_S = 5.0
ECHO = encode(ofp.OFPT_ECHO_REQUEST, 3, b"are you there?")
PACKET_IN = encode(ofp.OFPT_PACKET_IN, 0, bytes(100))
BARRIER = encode(ofp.OFPT_BARRIER_REPLY, 7)


def play(scene: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scene, DEADLINE_S))


class Paths:
    """Light paths that get ready when the test says so."""

    def __init__(self) -> None:
        self.go = asyncio.Event()
        self.asked = 0
        self.problem = ""

    async def ready(self) -> None:
        self.asked += 1
        await self.go.wait()
        if self.problem:
            raise NotReady(self.problem)


@dataclass
class End:
    """One end of a connection."""

    reader: StreamReader
    writer: StreamWriter

    async def hears(self, expected: bytes) -> None:
        assert await self.reader.readexactly(len(expected)) == expected

    async def hears_the_end(self) -> None:
        assert await self.reader.read() == b""


class Listener:
    """A controller: each connection to it comes out of `connections`."""

    def __init__(self) -> None:
        self.connections: asyncio.Queue[End] = asyncio.Queue()

    async def start(self, port: int = 0) -> int:
        self.server = await asyncio.start_server(self._accept, "127.0.0.1", port)
        return int(self.server.sockets[0].getsockname()[1])

    def _accept(self, reader: StreamReader, writer: StreamWriter) -> None:
        self.connections.put_nowait(End(reader, writer))


async def free_port() -> int:
    listener = Listener()
    port = await listener.start()
    listener.server.close()
    await listener.server.wait_closed()
    return port


@dataclass
class Stage:
    """A proxy with its bridge's and its controller's end."""

    proxy: Proxy
    port: int
    paths: Paths
    controllers: Listener
    bridge: End
    controller: End


@asynccontextmanager
async def stage(hold_deadline_s: float = DEADLINE_S) -> AsyncIterator[Stage]:
    paths, controllers, port = Paths(), Listener(), await free_port()
    proxy = Proxy(("127.0.0.1", await controllers.start()), paths.ready, hold_deadline_s)
    await proxy.serve(("127.0.0.1", port))
    bridge = End(*await asyncio.open_connection("127.0.0.1", port))
    controller = await controllers.connections.get()
    yield Stage(proxy, port, paths, controllers, bridge, controller)
    await proxy.close()
    for end in (bridge, controller):
        end.writer.close()
    controllers.server.close()


def test_messages_pass_both_ways_unchanged() -> None:
    async def scene() -> None:
        async with stage() as now:
            for one, other in ((now.bridge, now.controller), (now.controller, now.bridge)):
                one.writer.write(hello() + ECHO + PACKET_IN)
                await other.hears(hello() + ECHO + PACKET_IN)
            assert now.paths.asked == 0

    play(scene())


def test_held_reply_keeps_its_place() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.bridge.writer.write(PACKET_IN + BARRIER + ECHO + BARRIER + PACKET_IN)
            await now.controller.hears(PACKET_IN)
            now.controller.writer.write(ECHO)
            await now.bridge.hears(ECHO)
            early = asyncio.create_task(now.controller.reader.read(1))
            await asyncio.wait({early}, timeout=0.05)
            assert not early.done()
            now.paths.go.set()
            assert await early == BARRIER[:1]
            await now.controller.hears(BARRIER[1:] + ECHO + BARRIER + PACKET_IN)
            assert now.paths.asked == 1

    play(scene())


def test_barrier_request_is_not_held() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.controller.writer.write(encode(ofp.OFPT_BARRIER_REQUEST, 7))
            await now.bridge.hears(encode(ofp.OFPT_BARRIER_REQUEST, 7))

    play(scene())


def test_problem_is_an_error_in_the_replys_place() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.paths.problem = "the mirror is stuck"
            now.paths.go.set()
            now.bridge.writer.write(BARRIER + ECHO)
            await now.controller.hears(barrier_error(BARRIER) + ECHO)

    play(scene())


def test_hold_has_a_deadline(caplog: pytest.LogCaptureFixture) -> None:
    async def scene() -> None:
        async with stage(hold_deadline_s=0.05) as now:
            now.bridge.writer.write(BARRIER)
            await now.controller.hears(barrier_error(BARRIER))

    play(scene())
    assert "light paths were not ready in 0.05 s" in caplog.text


@pytest.mark.parametrize("rubbish", ["0115000800000001", "0515000000000001"])
@pytest.mark.parametrize("talker", ["bridge", "controller"])
def test_rubbish_closes_its_connection_alone(rubbish: str, talker: str) -> None:
    async def scene() -> None:
        async with stage() as now:
            other = End(*await asyncio.open_connection("127.0.0.1", now.port))
            other_controller = await now.controllers.connections.get()
            getattr(now, talker).writer.write(bytes.fromhex(rubbish))
            await now.bridge.hears_the_end()
            await now.controller.hears_the_end()
            other.writer.write(ECHO)
            await other_controller.hears(ECHO)
            other.writer.close()
            await other_controller.hears_the_end()
            other_controller.writer.close()

    play(scene())


@pytest.mark.parametrize("leaver", ["bridge", "controller"])
def test_end_of_one_side_ends_the_other(leaver: str) -> None:
    async def scene() -> None:
        async with stage() as now:
            getattr(now, leaver).writer.close()
            stayer = now.controller if leaver == "bridge" else now.bridge
            await stayer.hears_the_end()

    play(scene())


def test_bridge_is_connected_when_the_controller_comes_up() -> None:
    async def scene() -> None:
        port, controller_port = await free_port(), await free_port()
        proxy = Proxy(("127.0.0.1", controller_port), Paths().ready)
        await proxy.serve(("127.0.0.1", port))
        bridge = End(*await asyncio.open_connection("127.0.0.1", port))
        bridge.writer.write(hello())
        late = Listener()
        await late.start(controller_port)
        controller = await late.connections.get()
        await controller.hears(hello())
        await proxy.close()
        for end in (bridge, controller):
            end.writer.close()
        late.server.close()

    play(scene())


def test_bridge_that_leaves_is_not_connected_later() -> None:
    async def scene() -> None:
        port, controller_port = await free_port(), await free_port()
        proxy = Proxy(("127.0.0.1", controller_port), Paths().ready)
        await proxy.serve(("127.0.0.1", port))
        bridge = End(*await asyncio.open_connection("127.0.0.1", port))
        bridge.writer.write(hello())
        bridge.writer.write_eof()
        await bridge.hears_the_end()
        bridge.writer.close()
        await proxy.close()

    play(scene())


def test_held_reply_is_decided_before_the_end() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.paths.problem = "the dispatcher is gone"
            now.bridge.writer.write(BARRIER)
            while not now.paths.asked:
                await asyncio.sleep(0)
            closing = asyncio.create_task(now.proxy.close())
            await asyncio.sleep(0)
            now.paths.go.set()
            await closing
            await now.controller.hears(barrier_error(BARRIER))

    play(scene())
