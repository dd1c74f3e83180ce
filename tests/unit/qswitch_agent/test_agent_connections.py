"""Connections of a proxy: rubbish, ends, and a controller that comes later."""

import asyncio
import gc
import warnings
from asyncio import StreamReader
from unittest.mock import patch

import openflow_messages as of
import pytest
from optical_switch_scene import (
    ECHO,
    error,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import End, Listener, play, running_switch, stage

from qswitch_agent.openflow.messages import hello
from qswitch_agent.proxy.proxy import Proxy
from topologies.system.runs.runtime import free_port


def test_message_of_another_version_is_refused_after_the_hello() -> None:
    async def scene() -> None:
        async with stage() as now:
            older = bytes.fromhex("0414000800000009")  # a BARRIER_REQUEST of OpenFlow 1.3
            now.controller.says(hello(), older, ECHO)
            await now.controller.hears(error(ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_VERSION, older))
            await now.bridge.hears(hello(), ECHO)

    play(scene())


@pytest.mark.parametrize(
    ("rubbish", "talker"),
    [
        ("0115000800000001", "bridge"),
        ("0515000000000001", "bridge"),
        ("0515000000000001", "controller"),
    ],
)
def test_rubbish_closes_its_connection_alone(rubbish: str, talker: str) -> None:
    async def scene() -> None:
        async with stage() as now:
            other, other_controller = await now.connect()
            getattr(now, talker).says(bytes.fromhex(rubbish))
            await now.bridge.hears_the_end()
            await now.controller.hears_the_end()
            other.says(ECHO)
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
            while now.switch.connections:
                await asyncio.sleep(0)

    play(scene())


def test_bridge_is_connected_when_the_controller_comes_up() -> None:
    async def scene() -> None:
        port, controller_port = free_port(), free_port()
        async with running_switch() as (switch, *_rest):
            proxy = Proxy(("127.0.0.1", controller_port), switch)
            await proxy.serve(("127.0.0.1", port))
            bridge = End(*await asyncio.open_connection("127.0.0.1", port))
            bridge.says(hello())
            late = Listener()
            await late.start(controller_port)
            controller = await late.connections.get()
            await controller.hears(hello())
            await proxy.close()
            for end in (bridge, controller):
                end.writer.close()
            late.server.close()

    play(scene())


def test_all_pieces_of_what_the_bridge_says_before_the_controller_comes_up_are_kept() -> None:
    pieces = [hello()[:3], hello()[3:] + ECHO[:9], ECHO[9:], of.packet_in(9, of.PING)]
    taken, read = bytearray(), StreamReader.read

    async def counted(self: StreamReader, most: int = -1) -> bytes:
        data = await read(self, most)
        taken.extend(data)
        return data

    async def scene() -> None:
        port, controller_port = free_port(), free_port()
        async with running_switch() as (switch, *_rest):
            proxy = Proxy(("127.0.0.1", controller_port), switch)
            await proxy.serve(("127.0.0.1", port))
            with patch.object(StreamReader, "read", counted):
                bridge = End(*await asyncio.open_connection("127.0.0.1", port))
                for number, piece in enumerate(pieces, 1):
                    bridge.says(piece)
                    while len(taken) < sum(map(len, pieces[:number])):
                        await asyncio.sleep(0)
            late = Listener()
            await late.start(controller_port)
            controller = await late.connections.get()
            await controller.hears(hello(), ECHO, pieces[-1])
            await proxy.close()
            for end in (bridge, controller):
                end.writer.close()
            late.server.close()

    play(scene())


def test_bridge_that_leaves_is_not_connected_later() -> None:
    async def scene() -> None:
        port, controller_port = free_port(), free_port()
        async with running_switch() as (switch, *_rest):
            proxy = Proxy(("127.0.0.1", controller_port), switch)
            await proxy.serve(("127.0.0.1", port))
            bridge = End(*await asyncio.open_connection("127.0.0.1", port))
            bridge.says(hello())
            bridge.writer.write_eof()
            await bridge.hears_the_end()
            bridge.writer.close()
            await proxy.close()

    play(scene())


def test_proxy_that_ends_while_it_connects_leaves_nothing_open() -> None:
    async def scene() -> None:
        async with stage():
            pass

    gc.collect()  # of what tests before it have left
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", ResourceWarning)
        play(scene())
        gc.collect()
    assert [str(one.message) for one in warned] == []
